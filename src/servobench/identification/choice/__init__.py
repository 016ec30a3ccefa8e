"""Which model, and of what: the structure, the noise model, the records that go together, the counts behind a speed.

Each tries a few fits and keeps one, by a test; `structure_ladder` climbs from a structure to the next larger one.
"""

"""The choice of the model and the data: the structure, the noise model, the records that agree, the counts behind a speed.

Each compares a few fits and keeps one, by a test; `structure_ladder` goes from a structure to the next larger one.
"""

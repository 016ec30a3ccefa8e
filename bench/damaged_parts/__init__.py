"""The parts of `bench/damaged.py`: our own recordings, ways to damage them, and the page.

The tests use the same recordings and the same damages, one seed each.
"""

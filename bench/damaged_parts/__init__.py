"""What `bench/damaged.py` is made of: recordings of ours, ways to damage them, and the page.

The tests use the same recordings and the same damages, one seed each.
"""

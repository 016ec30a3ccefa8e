"""What `bench/accuracy.py` is made of: simulated motors, the bound, the rows, their runs and the page.

No simulator here shares a line with `servobench.motor` or `servobench.models`: they are what both are held against.
"""

"""The parts of `bench/accuracy.py`: simulated motors, the bound, the rows, their runs and the page.

No simulator here shares a line with `rig.motor` or `identification.models`: they are what both are compared with.
"""

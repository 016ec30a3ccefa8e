"""What `bench/population.py` is made of: random motors, an exact simulator, the bound, what is said of each record, the judge.

Simulator and bound share no line with the package: they are what it is held against.
"""

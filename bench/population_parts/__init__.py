"""The parts of `bench/population.py`: random motors, an exact simulator, the bound, the statements on each record, the judge.

Simulator and bound share no line with the package: they are what it is compared with.
"""

"""The grid that quantised values lie on."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array

_LEAST_STEPS = 8  # between distinct values; by chance all of them fit a grid once in 10^8
_MISFIT = 0.05  # of a step; what printing with a few digits leaves
_FINEST = 1e-6  # of the range; what is finer is the floating-point grid, or doesn't matter
_DIVISORS = range(
    1, 13
)  # the shortest distance may be several steps: no two neighbours on the grid need occur
# Distinct values: of any at most 28 in a hundred lie that near to a sensor's step, so by chance 30 do once in 10^16.
_PLENTY = 30
_BITS = range(8, 17)  # of an angle sensor
_DECIMALS = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)


def grid_step(x: Array) -> float | None:
    """Return the step of the grid that all values x (N,) lie on, or None where they lie on none.

    The distances between distinct values, in order, have to be whole multiples of one step, up to what printing with
    a few digits leaves. A ramp at constant speed looks like a grid as well: so either half of the values have to repeat, or
    at least three different multiples have to occur, or values that last for three different numbers of samples.
    """
    values = np.unique(x)
    steps = np.diff(values)
    span = float(values[-1] - values[0]) if len(values) else 0.0
    steps = steps[steps > 1e-3 * _FINEST * span]  # the same value but for rounding
    if len(steps) < _LEAST_STEPS:
        return None
    for divisor in _DIVISORS:
        multiples = np.rint(steps * divisor / steps.min())
        step = float(steps.sum() / multiples.sum())
        fits = np.abs(steps / step - multiples).max() <= _MISFIT
        evident = len(np.unique(multiples)) >= 3 or len(steps) < 0.5 * len(x) or _count_durations(x) >= 3
        if fits and evident and step > _FINEST * span:
            return step
    return None


def last_decimal(x: Array) -> float | None:
    """Return the power of ten that all values x (N,), in the unit that they were printed in, are multiples of.

    The largest from 1 to a millionth; None where there is none, as for values with all of a float's digits.
    """
    for step in _DECIMALS:
        multiples = x / step
        if np.abs(multiples - np.rint(multiples)).max(initial=0.0) < _MISFIT * 1e-3:
            return step
    return None


def steps_behind_decimals(x: Array, step: float) -> int | None:
    """Return the number of steps in a turn of a sensor whose angles x (N,) [rad] were rounded to multiples of `step` [rad] later.

    A magnetic encoder of 12 bits that is printed in hundredths of a degree has 4096. Only powers of two are looked for, whose
    steps are at least four times as large; x counts from the sensor's zero. None where there is none, and where all values are
    multiples of several of its steps: a coarser sensor, whose steps may lie on those of a finer one by chance, isn't finer.
    """
    values = np.unique(x)
    if len(values) < _PLENTY:
        return None
    for bits in _BITS:
        steps = values * (2**bits / (2.0 * np.pi))
        whole = np.rint(steps)
        off = np.abs(steps - whole).max() * (2.0 * np.pi / 2**bits)
        if 2.0 * np.pi / 2**bits >= 4.0 * step and off <= (0.5 + _MISFIT) * step:
            return int(2**bits) if np.gcd.reduce(np.diff(whole).astype(int)) == 1 else None
    return None


def _count_durations(x: Array) -> int:
    """The number of different times, in samples, for which a value lasts, those at the start and the end of x (N,) left out."""
    changes = np.flatnonzero(np.diff(x) != 0)
    return len(np.unique(np.diff(changes)))

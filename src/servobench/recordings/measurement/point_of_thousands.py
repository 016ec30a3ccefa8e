"""A point between thousands that was read as a decimal point: 999 is followed by 1.013, which is 1013."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array

_ROUNDING = 1e-6  # of a thousand times a decimal number, as floats
_SMOOTHER = 0.5  # times the longest step, at most, that is left with the point taken out


def are_thousands(x: Array) -> bool:
    """Return whether all numbers of x (N,) that aren't whole seem to have a point between their thousands.

    With the point taken out they are whole numbers of at least 1000, all others are below that, and the longest step from one
    sample to the next is less than half as long. Whether it is so can't be known: nothing is converted.
    """
    x = x[np.isfinite(x)]
    thousands = 1000.0 * x
    broken = x != np.rint(x)
    if not broken.any() or broken.all() or np.abs(x).max() >= 1000.0 or np.abs(x[broken]).min() < 1.0:
        return False
    if np.abs(thousands - np.rint(thousands)).max() > _ROUNDING:
        return False
    return _longest_step(_without_points(x, broken)) < _SMOOTHER * _longest_step(x)


def _without_points(x: Array, broken: NDArray[np.bool_]) -> Array:
    """The numbers with the point taken out; 2.000 was read as 2, and is what lies nearer to the number before."""
    result = np.where(broken, 1000.0 * x, x)
    for k in np.flatnonzero(~broken & (x != 0)):
        if k and abs(1000.0 * x[k] - result[k - 1]) < abs(x[k] - result[k - 1]):
            result[k] = 1000.0 * x[k]
    return result


def _longest_step(x: Array) -> float:
    return float(np.abs(np.diff(x)).max())

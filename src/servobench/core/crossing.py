"""Where a function of one variable crosses zero, between two ends."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

_MOST = 2200  # halvings between the largest and the smallest numbers there are, of either sign
_CLOSE = 4 * sys.float_info.epsilon


def crossing(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a continuous function with opposite signs at two ends is zero, to the last digits of a number.

    Inverse quadratic interpolation through the last three places where that can be relied on, halving elsewhere
    (Chandrupatla 1997). SciPy's `brentq` finds the same, but importing it takes longer than identifying a motor.

    :param function: what crosses zero, of a number
    :param low: one end
    :param high: the other end
    :return: the zero
    :raises ValueError: if the function has the same sign at both ends; look for the zero between others
    """
    last, other = float(low), float(high)
    at_last, at_other = function(last), function(other)
    if at_last * at_other > 0:
        raise ValueError(
            f"the function is {at_last:g} at {low:g} and {at_other:g} at {high:g}: "
            "a crossing was expected between two ends of opposite sign"
        )
    if at_other == 0:
        return other
    share = 0.5  # of the way from the last place to the other end
    for _ in range(_MOST):
        if at_last == 0:
            break
        new = last + share * (other - last)
        at_new = function(new)
        if math.copysign(1.0, at_new) == math.copysign(1.0, at_last):
            before, at_before = last, at_last
        else:
            before, at_before, other, at_other = other, at_other, last, at_last
        last, at_last = new, at_new
        near = _CLOSE * abs(last if abs(at_last) < abs(at_other) else other) + sys.float_info.min
        if abs(other - last) <= 2 * near:
            break
        least = near / abs(other - last)
        share = min(max(_share(last, at_last, other, at_other, before, at_before), least), 1 - least)
    return last if abs(at_last) < abs(at_other) else other


def _share(a: float, at_a: float, b: float, at_b: float, c: float, at_c: float) -> float:
    """How far along the way from a to b inverse quadratic interpolation through three places puts the zero; else a half."""
    x, y = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
    if not 1 - math.sqrt(1 - x) < y < math.sqrt(x):
        return 0.5
    return at_a / (at_b - at_a) * at_c / (at_b - at_c) + (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (
        at_c - at_b
    )

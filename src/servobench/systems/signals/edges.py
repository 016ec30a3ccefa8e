"""On which side of an edge a time falls.

A sample time of 0.002 s is no binary fraction, so that the time k · 0.002 s, or its product with a frequency, may miss an edge
by a rounding error, to either side. Therefore a time that misses an edge by less than a billionth of the period, or of a
second where there is no period, counts as on the edge, and what comes after the edge holds there. For long times the
margin grows with the rounding error of the time itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array

_MARGIN = 1e-9
# The step, the frequency, the phase, their products and differences are each rounded once: less than four roundings, taken twice.
_ROUNDING = 8 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Periods:
    """The position of times in a periodic signal.

    `whole` (N,) periods have been completed, `fraction` (N,) in [0, 1) of the next one; `started` (N,) is False before the start.
    `margin` (N,) is by how much rounding may have moved the fraction.
    """

    whole: Array
    fraction: Array
    started: NDArray[np.bool_]
    margin: Array

    def before(self, edge: float) -> NDArray[np.bool_]:
        """Return where the current period hasn't reached the edge yet, a fraction of it in [0, 1]."""
        return np.asarray(self.fraction < edge - self.margin)


def periods(t: Array, frequency: float, start: float, phase: float = 0.0) -> Periods:
    """Return where times t (N,) [s] lie in a signal of that frequency [Hz] that begins at `start` [s] with that phase [rad]."""
    t = np.asarray(t, dtype=float)
    since_start = frequency * (t - start)
    cycles = since_start + phase / (2 * math.pi)
    earliest = _MARGIN + _ROUNDING * (frequency * abs(start) + abs(phase))
    margin = earliest + _ROUNDING * frequency * np.abs(t)
    whole = np.floor(cycles + margin)
    return Periods(whole, np.maximum(cycles - whole, 0.0), since_start >= -margin, margin)


def is_past(t: Array, edge: float) -> NDArray[np.bool_]:
    """Return where times t (N,) [s] are at or after an edge [s]."""
    t = np.asarray(t, dtype=float)
    return np.asarray(t - edge >= -(_MARGIN + _ROUNDING * (np.abs(t) + abs(edge))))

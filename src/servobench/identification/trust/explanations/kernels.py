"""The compiled kernels of the causes: an input that goes through a play, a signal that goes through a lag."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.compiled import compiled


@compiled
def play(u: Array, width: float) -> Array:
    """Return u (N,) behind a play of `width` on either side, in the unit of u, from its first value on."""
    out, now = np.empty(len(u)), u[0]
    for k in range(len(u)):
        now = min(max(now, u[k] - width), u[k] + width)
        out[k] = now
    return out


@compiled
def lag(x: Array, now: float, before: float, left: float) -> Array:
    """Return y (N,) from rest, y_k = now x_k + before x_{k-1} + left y_{k-1}: a lag, or the derivative behind one.

    The direct form of a first-order section (Oppenheim and Schafer 2010, section 6.3).
    """
    out = np.empty(len(x))
    x1 = y1 = 0.0
    for k in range(len(x)):
        y1 = now * x[k] + before * x1 + left * y1
        x1 = x[k]
        out[k] = y1
    return out

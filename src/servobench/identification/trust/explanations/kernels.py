"""The compiled kernel of the causes: an input that goes through a play."""

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

"""What comes out of a play: it rests until the gap is used up, then follows. A compiled kernel."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.compiled import compiled


@compiled
def behind_play(x: Array, width: float, start: float) -> Array:
    """Return x (N,) behind a play of `width` on either side, in the unit of x, that stands at `start` before the first."""
    out, now = np.empty(len(x)), start
    for k in range(len(x)):
        now = min(max(now, x[k] - width), x[k] + width)
        out[k] = now
    return out

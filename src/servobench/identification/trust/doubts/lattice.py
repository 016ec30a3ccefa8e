"""The step of values that only come in multiples of it."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array

_MOST = 20_000  # values that are examined
_SAME = 1e-9  # of the range: what differs less is the same value, computed in two ways


def lattice_step(y: Array) -> float | None:
    """Return the step q where nearly all differences of values y (N,) are multiples of q; None where they aren't.

    q is such that all differences between neighbouring distinct values together are a whole number of it: the smallest one alone
    would carry the rounding of the file's digits along.
    """
    values = _distinct(y[:: max(1, len(y) // _MOST)])
    if len(values) < 3:
        return float(values[1] - values[0]) if len(values) == 2 else None
    steps = np.diff(values)
    real = steps > 1e-3 * float(np.median(steps))
    q = float(steps[real].sum() / np.rint(steps[real] / steps[real].min()).sum())
    multiples = (values - values[0]) / q
    off = np.abs(multiples - np.rint(multiples))
    # Every value has to be near a multiple; of values without a lattice a fifth are within a tenth of one.
    return q if np.mean(off < 0.1) > 0.95 and len(values) < 0.5 * len(y) else None


def _distinct(y: Array) -> Array:
    """The distinct values, in their order; of those that differ by rounding alone the first."""
    values = np.unique(y)
    apart = np.diff(values, prepend=-np.inf) > _SAME * (values[-1] - values[0])
    return np.asarray(values[apart], dtype=np.float64)

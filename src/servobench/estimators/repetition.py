"""Errors that repeat with the input: folding a record on the input's period.

Where a motor goes to and fro in the same way again and again, it comes back to the same counts, and an encoder's rounding
repeats. It then averages out within a period but not over the periods, as the usual covariance takes for granted. Summed over
the periods first, the scores show it.
"""

from __future__ import annotations

import numpy as np

from servobench.channels import Array
from servobench.measurement.dataset import Dataset

_PROBES = 32
_SAME = 1e-9  # of the input's range
_REPEATS = 0.6  # correlation of the residual with itself a period before; chance gives 0.014 in 5,000 samples


def period(data: Dataset) -> int | None:
    """Return after how many samples a record's input repeats, twice at least; None where it doesn't or the times are uneven."""
    u, t = data.u, data.t_output
    n = len(u)
    if n < 4 or len(t) != n or np.ptp(u) == 0 or np.ptp(np.diff(t)) > 1e-3 * data.sample_time:
        return None
    near = _SAME * float(np.ptp(u))
    changes = np.flatnonzero(np.abs(np.diff(u)) > near)
    # A held input repeats after the distance of two of its changes; one that always changes, after any time.
    shifts = changes[1:] - changes[0] if len(changes) < n // 4 else np.arange(1, n)
    shifts = shifts[shifts <= n // 2]
    probes = np.linspace(0, n - n // 2 - 1, _PROBES).astype(int)[:, None]
    alike = (np.abs(u[probes + shifts] - u[probes]) <= near).all(axis=0)
    for shift in shifts[alike]:
        if np.abs(u[shift:] - u[:-shift]).max() <= near:
            return int(shift)
    return None


def repeats(residual: Array, length: int) -> bool:
    """Return whether a residual (N,) is alike in successive periods of `length` samples."""
    now, before = residual[length:], residual[:-length]
    power = float(np.sqrt(np.sum(now**2) * np.sum(before**2)))
    return power > 0 and float(now @ before) > _REPEATS * power


def folded(scores: Array, length: int) -> Array:
    """Return scores (N, P) summed over the periods, (length, P); the last period may be cut short."""
    cycles = -(-len(scores) // length)
    whole = np.zeros((cycles * length, scores.shape[1]))
    whole[: len(scores)] = scores
    return np.asarray(whole.reshape(cycles, length, -1).sum(axis=0), dtype=np.float64)

"""Do two records hold the same samples: a copy, one that was cut, or one whose angle counts from elsewhere?"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.dataset import Dataset

_FEW = 16  # samples that are compared first: two runs, even under one input, differ in them
_SHARE = 0.5  # of the shorter record: from there on it is mainly a part of the other one
_ROUNDING = 1e-8  # of the largest value: digits that a table may have lost


def share_samples(one: Dataset, other: Dataset) -> bool:
    """Return whether more than half of the shorter record's samples are in the other one, at the same times.

    The same are those with the same input whose outputs differ by one constant, but for rounding. Of a shaft that didn't move in
    them nothing can be said: False.
    """
    if one.digest == other.digest:
        return True
    shorter, longer = sorted((one, other), key=lambda data: len(data.y))
    times = shorter.t_output
    few = np.unique(np.linspace(0, len(times) - 1, _FEW).astype(np.int64))
    return _agree(shorter, longer, times[few], _SHARE / 2) and _agree(shorter, longer, times, _SHARE)


def _agree(one: Dataset, other: Dataset, times: Array, share: float) -> bool:
    """Whether two records agree wherever both have a sample at one of these times (T,), and in a share of them at least."""
    common = times[np.isin(times, other.t_output)]
    if len(common) <= share * len(times):
        return False
    y, there = (data.y[np.searchsorted(data.t_output, common)] for data in (one, other))
    u, other_u = (data.u[data.hold_indices(common)] for data in (one, other))
    apart = y - there
    rounding = _ROUNDING * max(float(np.abs(y).max()), float(np.abs(there).max()))
    return bool(np.ptp(y) > rounding and np.ptp(apart) <= rounding and np.array_equal(u, other_u))

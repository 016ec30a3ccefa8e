"""Single values that lie far off their neighbours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.formats.times import in_words
from servobench.recordings.measurement.dataset import Dataset

_LARGE = 6.0  # times what is usual among the largest second differences
_MOST = 0.02  # of the samples: more than that isn't a few spikes but noise


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _of(record)]


def _of(data: Dataset) -> list[Finding]:
    if any(finding.code == "angle-wraps" for finding in data.findings):
        return []
    which = spikes(data.y, data.quantum or 0.0)
    if not len(which):
        return []
    rows = (int(which[0]) + 1, int(which[-1]) + 1)
    sentence = (
        f"{data.name}: the output jumps away and back again within a sample or two in "
        f"{in_words(which + 1, 'sample')}, which no shaft does. It is cable noise or a lost count; "
        "leave these rows out."
    )
    return [warning("output-spikes", sentence, parameters=("gain", "time_constant"), rows=rows)]


def spikes(y: Array, quantum: float) -> NDArray[np.int64]:
    """Return the indices (K,) of single values of y (N,) that lie far off both neighbours, on the same side of both.

    The departure from the mean of the neighbours is compared with the 98th percentile of all, and with two quanta.
    """
    if len(y) < 50:
        return np.array([], dtype=np.int64)
    off = y[1:-1] - 0.5 * (y[2:] + y[:-2])
    limit = _LARGE * max(float(np.percentile(np.abs(off), 98)), 0.5 * quantum)
    beyond = (y[1:-1] - y[2:]) * (y[1:-1] - y[:-2]) > 0
    indices = np.flatnonzero((np.abs(off) > limit) & beyond) + 1
    indices = np.array([k for k in indices.tolist() if _goes_on(y, k)], dtype=np.int64)
    return indices if len(indices) <= _MOST * len(y) and limit > 0 else np.array([], dtype=np.int64)


def _goes_on(y: Array, k: int) -> bool:
    """Whether the values around sample k go on as if it weren't there: at a reversal they don't."""
    if not 2 <= k < len(y) - 2:
        return False
    across = 0.5 * (y[k + 1] - y[k - 1])
    size = abs(y[k] - 0.5 * (y[k + 1] + y[k - 1]))
    return bool(
        abs(y[k - 1] - y[k - 2] - across) < 0.5 * size and abs(y[k + 2] - y[k + 1] - across) < 0.5 * size
    )


DOUBTS.member("spikes")(Doubt(codes=("output-spikes",), about_data=_about))

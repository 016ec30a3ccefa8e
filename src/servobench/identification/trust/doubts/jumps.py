"""A position that goes on from somewhere else: rows or a turn lost, a coupling that slipped, a counter that was set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.formats.times import in_words
from servobench.recordings.measurement.dataset import Dataset

_LARGE = 6.0  # times what is usual among the largest departures
_QUANTA = 4.0  # steps of the sensor: a few may be lost, or come together, in an interrupt that is late
_MOST = 0.005  # of the samples: more than that isn't a few jumps but how this sensor works


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _of(record)]


def _of(data: Dataset) -> list[Finding]:
    if data.kind != "position" or any(finding.code == "angle-wraps" for finding in data.findings):
        return []
    which = jumps(data.t_output, data.y, data.quantum or 0.0)
    if not len(which):
        return []
    size = float(data.y[which[0] + 1] - data.y[which[0]])
    at = int(which[0]) + 1
    where = f"{in_words(data.row_numbers(which + 1), 'sample')} ({data.in_seconds(data.t_output[at])})"
    sentence = (
        f"{data.name}: the position jumps in {where}, first by {with_unit(size, data.output_unit)}, and goes on from there, "
        "which no shaft does: rows are missing, a turn was lost, a coupling slipped, or the counter was set. Use the part before "
        "or after it."
    )
    rows = data.row_span(at, int(which[-1]) + 1)
    return [warning("output-jumps", sentence, parameters=("gain", "time_constant"), rows=rows)]


def jumps(t: Array, y: Array, quantum: float) -> NDArray[np.int64]:
    """Return the indices (K,) of the samples of y (N,) at times t (N,) [s] after which it goes on from somewhere else.

    A step from one sample to the next is compared with those two before and after it, which have to agree with each other. What
    it departs from them by is compared with the 99th percentile of all and with four quanta. A shaft that friction lets go for
    a moment, slowly sampled, steps as well: from rest to rest, and no faster than it goes elsewhere.
    """
    if len(y) < 50:
        return np.array([], dtype=np.int64)
    step = np.diff(t)
    speed = np.diff(y) / step
    usual, range_of_four = _middle_and_range(*(speed[at : len(speed) - 4 + at] for at in (0, 1, 3, 4)))
    off = np.abs(speed[2:-2] - usual) * step[2:-2]
    differ = range_of_four * step[2:-2]
    limit = max(_LARGE * float(np.percentile(off, 99)), _QUANTA * quantum)
    indices = np.flatnonzero((off > limit) & (off > 2.0 * differ)) + 2
    top = float(np.abs(np.delete(speed, indices)).max(initial=0.0))
    twitches = (usual[indices - 2] == 0.0) & (np.abs(speed[indices]) <= top)
    indices = indices[~twitches]
    return indices if len(indices) <= _MOST * len(y) and limit > 0 else np.array([], dtype=np.int64)


def _middle_and_range(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """The medians and the ranges (N,) of four numbers each, a tenth of the time that NumPy takes for any number of them."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    lower, higher = np.minimum(c, d), np.maximum(c, d)
    middle = 0.5 * (np.maximum(low, lower) + np.minimum(high, higher))
    return middle, np.maximum(high, higher) - np.minimum(low, lower)


DOUBTS.member("jumps")(Doubt(codes=("output-jumps",), about_data=_about))

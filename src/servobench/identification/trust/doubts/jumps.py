"""An output that goes on from somewhere else: lost rows or turns, a coupling that slipped, a counter set anew, another run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.formats.times import in_words
from servobench.recordings.measurement.dataset import Dataset

_LARGE = 6.0  # times what is usual among the largest departures
_QUANTA = 4.0  # steps of the sensor: a few may be lost, or come together, in an interrupt that is late
_STAYS = 0.5  # of a jump, two samples later
_LONGER = 8  # samples to either side, whose times don't matter one by one
_SEAM = 0.4  # of the top speed: what a speed changes by where another run begins, and its model doesn't
_BESIDE = 3  # samples on either side: a reading that is wrong by itself, or a row late, is no other run
_SETTLING = 10  # samples that a simulation may take to get to where the other run is
_LEFT = 0.15  # of the change, after three samples: a step that is a sample late leaves nothing
_ALONE = 4.0  # times what the residual changes by anywhere else
_MOST = 0.005  # of the samples: more than that isn't a few jumps but how this sensor works


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _of(record)]


def _of(data: Dataset) -> list[Finding]:
    if data.kind != "position" or any(finding.code == "angle-wraps" for finding in data.findings):
        return []
    which = jumps(data.t_output, data.y, data.quantum or 0.0)
    if not len(which):
        return []
    steps = np.diff(data.y)
    # Beyond what it goes in a row anyway: a shaft that seems to stand for one lacks a step.
    size = float(steps[which[0]] - np.median(steps[which[0] + np.array([-2, -1, 1, 2])]))
    sentence = (
        f"the position jumps in {_places(data, which)}, first by {with_unit(size, data.output_unit)}, and goes on from there, "
        "which no shaft does: rows are missing, a turn was lost, a coupling slipped, or the counter was set. Use the part before "
        "or after it."
    )
    return [_finding(data, which, sentence)]


def _places(data: Dataset, which: NDArray[np.int64]) -> str:
    """The samples behind those indices (K,), and the time of the first, in words."""
    return (
        f"{in_words(data.row_numbers(which + 1), 'sample')} ({data.in_seconds(data.t_output[which[0] + 1])})"
    )


def _finding(data: Dataset, which: NDArray[np.int64], sentence: str) -> Finding:
    rows = data.row_span(int(which[0]) + 1, int(which[-1]) + 1)
    return warning(
        "output-jumps", f"{data.name}: {sentence}", parameters=("gain", "time_constant"), rows=rows
    )


def jumps(t: Array, y: Array, quantum: float) -> NDArray[np.int64]:
    """Return the indices (K,) of the samples of y (N,) at times t (N,) [s] after which it goes on from somewhere else.

    A step from one sample to the next is compared with those two before and after it, which have to agree with each other. What
    it departs from them by is compared with the 99th percentile of all and with four quanta. It has to depart by its size as well
    as by its rate: of a sensor that is read at an even rate some values come a row late, and are written with its time. A shaft
    that friction lets go for a moment, slowly sampled, steps as well: from rest to rest, and no faster than it goes elsewhere.
    And it has to last, as the next step makes up for a time that was written late.
    """
    if len(y) < 50:
        return np.array([], dtype=np.int64)
    step, move = np.diff(t), np.diff(y)
    speed = move / step
    usual, range_of_four = _middle_and_range(*(speed[at : len(speed) - 4 + at] for at in (0, 1, 3, 4)))
    usual_move, _ = _middle_and_range(*(move[at : len(move) - 4 + at] for at in (0, 1, 3, 4)))
    off = np.minimum(np.abs(speed[2:-2] - usual) * step[2:-2], np.abs(move[2:-2] - usual_move))
    differ = range_of_four * step[2:-2]
    limit = max(_LARGE * float(np.percentile(off, 99)), _QUANTA * quantum)
    indices = np.flatnonzero((off > limit) & (off > 2.0 * differ)) + 2
    top = float(np.abs(np.delete(speed, indices)).max(initial=0.0))
    twitches = (usual[indices - 2] == 0.0) & (np.abs(speed[indices]) <= top)
    indices = indices[~twitches]
    indices = indices[_lasts(t, y, speed, indices)]
    return indices if len(indices) <= _MOST * len(y) and limit > 0 else np.array([], dtype=np.int64)


def _lasts(t: Array, y: Array, speed: Array, indices: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether what positions y (N,) at times t (N,) [s] jump by after samples (K,) is still there two samples later.

    A time that is written late, or early, makes up for itself in the next step. `speed` (N - 1,) is that of each step.
    """
    before, after = indices - 2, indices + 3
    first, last = np.maximum(before - _LONGER, 0), np.minimum(after + _LONGER, len(y) - 1)
    way, time = (x[last] - x[after] + x[before] - x[first] for x in (y, t))
    # The mean over a coarse encoder's steps, and the median where another jump is near: what lasts by either does.
    medians = [
        np.median(np.concatenate([speed[a:b], speed[c:d]]))
        for a, b, c, d in zip(first, before, after, last, strict=True)
    ]
    lasts = np.zeros(len(indices), dtype=np.bool_)
    for usual in (way / time, np.array(medians)):
        at_once = y[indices + 1] - y[indices] - usual * (t[indices + 1] - t[indices])
        lasts |= np.abs(y[after] - y[before] - usual * (t[after] - t[before])) > _STAYS * np.abs(at_once)
    return lasts


def _middle_and_range(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """The medians and the ranges (N,) of four numbers each, a tenth of the time that NumPy takes for any number of them."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    lower, higher = np.minimum(c, d), np.maximum(c, d)
    middle = 0.5 * (np.maximum(low, lower) + np.minimum(high, higher))
    return middle, np.maximum(high, higher) - np.minimum(low, lower)


def _about_fit(fit: Fit) -> list[Finding]:
    """A warning for each record of a speed that changes at once by what its model takes many samples for."""
    return [finding for record in fit.records for finding in _of_seams(record)]


def _of_seams(record: FittedRecord) -> list[Finding]:
    data, which = record.data, seams(record)
    if not len(which):
        return []
    before, after = (with_unit(float(data.y[which[0] + n]), data.output_unit, 3) for n in (0, 1))
    sentence = (
        f"the speed is another one at once in {_places(data, which)}, first {after} after {before}, while its model takes many "
        "samples for such a change: two runs were put together, rows are missing, or something stopped the shaft. Give each run "
        "by itself."
    )
    return [_finding(data, which, sentence)]


def seams(record: FittedRecord) -> NDArray[np.int64]:
    """Return the indices (K,) of the samples after which a speed goes on as another, while the simulation does as before."""
    data, residual = record.data, np.where(record.valid, record.residual, np.nan)
    none = np.array([], dtype=np.int64)
    if data.kind != "speed" or len(data.y) < 50:
        return none
    change = np.nan_to_num(np.abs(np.diff(residual)))
    change[:_SETTLING] = (
        0.0  # where a record begins, from a start state that isn't known, its model may jump as well
    )
    large = _SEAM * float(np.percentile(np.abs(data.y), 99))
    which = np.flatnonzero(change[:-_BESIDE] > large)
    if not 0 < len(which) <= max(_MOST * len(data.y), 1):
        return none
    after = which[:, None] + np.arange(_SETTLING)
    elsewhere = np.delete(change, np.unique(after[after < len(change)]))
    alone = _ALONE * float(elsewhere.max(initial=0.0)) < float(change[which].min())
    return which if alone and all(_goes_on(data.y, residual, int(n), large) for n in which) else none


def _goes_on(y: Array, residual: Array, at: int, large: float) -> bool:
    """Whether the output stays another one after a sample, and its simulation isn't right again three samples later."""
    before, after = slice(at + 1 - _BESIDE, at + 1), slice(at + 1, at + 1 + _BESIDE)
    moved = abs(float(np.median(y[after]) - np.median(y[before])))
    left = abs(float(residual[after][-1] - np.median(residual[before])))
    return moved > large and left > _LEFT * large


DOUBTS.member("jumps")(Doubt(codes=("output-jumps",), about_data=_about, about_fit=_about_fit))

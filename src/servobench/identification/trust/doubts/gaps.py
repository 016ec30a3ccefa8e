"""Uneven times, gaps in which the input isn't known, and rows that were read late."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.formats.times import GAP, UNEVEN
from servobench.recordings.measurement.dataset import Dataset

_CHANGED = 0.05  # of the input's range: a smaller change over a gap doesn't matter
_RARELY = 0.25  # changes to be expected in a gap: there and back again is two, in one gap in 30
# What a run of ours says of itself: in ticks that were missed nothing was written, in rows that were lost something was.
_HELD, _ROWS_LOST = "samples-missed", "rows-not-recorded"
_BESIDE, _SEVERAL = 5, 3  # rows to either side of a gap, and gaps, that show how the output goes on
_OFTEN = 0.1  # of the steps: so many are no gaps, but a rate
_LONG = 8.0  # steps: a shorter gap doesn't show it
# By how much an output has to change on average to show it, in standard deviations of its changes from row to row: three of those
# of the mean of ten such changes where each row has noise of its own, as the ends of both sides alone count in it.
_MOVES = 3.0 * 0.2 / 2**0.5
_LESS = 0.3  # of what is left over if time had gone on: it hasn't
_IN_EVERY_ROW = (
    0.9  # of the input's values come one to a sample of the output, and not only when the input changed
)


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in (*_unknown_input(record), *_scatter_finding(record))]


def _unknown_input(data: Dataset) -> list[Finding]:
    """Whether rows are missing in which the input may have changed, for inputs that are written in every row."""
    codes = {finding.code for finding in data.findings}
    if _HELD in codes and _ROWS_LOST not in codes:
        return []
    steps = np.diff(data.t_input)
    if len(steps) < 10 or _in_every_row(data) < _IN_EVERY_ROW:
        return []
    typical = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP * typical)
    gaps = gaps[~_late(data.t_input, gaps, typical)]
    if _came_in_bursts(data, gaps):
        return [_bursts(data, gaps)]
    unknown = [
        int(k)
        for k in gaps
        if _may_have_changed(data.u, int(k), round(float(steps[k]) / typical)) and not _is_rest(data, int(k))
    ]
    if not unknown or len(gaps) > _OFTEN * len(steps):
        return []  # none, or the input is logged at several rates
    longest = max(unknown, key=lambda k: float(steps[k]))
    many = "is a gap" if len(unknown) == 1 else f"are {len(unknown)} gaps"
    sentence = (
        f"{data.name}: there {many} of up to {steps[longest]:.3g} s (at "
        f"{data.in_seconds(data.t_input[longest])}), and it isn't known when the input changed there; the "
        "model holds the last value. Cut the file at the gap and give the parts as two files, or "
        "record again without losing rows."
    )
    rows = (unknown[0] + 1, unknown[-1] + 2)
    return [warning("gap-input-unknown", sentence, parameters=("gain", "time_constant", "delay"), rows=rows)]


def _in_every_row(data: Dataset) -> float:
    """The share of the input's values that come one sample of the output after the one before, be it with it or after it."""
    return float(np.mean(np.diff(np.searchsorted(data.t_output, data.t_input, side="right")) == 1))


def _late(t: Array, gaps: NDArray[np.int64], typical: float) -> NDArray[np.bool_]:
    """Whether nothing is missing in gaps of times t (N,), as so many values follow at once: they came late, all of them."""
    expected = np.rint((t[gaps + 1] - t[gaps]) / typical)
    came = np.searchsorted(t, t[gaps + 1] + 0.5 * typical, side="right") - (gaps + 1)
    return np.asarray(came >= expected)


def _came_in_bursts(data: Dataset, gaps: NDArray[np.int64]) -> bool:
    """Whether the output changes over several gaps as it does from row to row, and not as it would in so much time."""
    per_row, per_time, count = 0.0, 0.0, 0
    steps = np.diff(data.t_output)
    typical = float(np.median(steps))
    for k in np.searchsorted(data.t_output, data.t_input[gaps]).tolist():
        if not _BESIDE <= k < len(steps) - _BESIDE or steps[k] < _LONG * typical:
            continue
        if np.delete(steps[k - _BESIDE : k + 1 + _BESIDE], _BESIDE).max() > GAP * typical:
            continue  # not one gap in even rows
        beside = np.concatenate(
            [np.diff(data.y[k - _BESIDE : k + 1]), np.diff(data.y[k + 1 : k + 2 + _BESIDE])]
        )
        row, change = float(beside.mean()), float(data.y[k + 1] - data.y[k])
        if abs(row) <= _MOVES * float(beside.std()):
            continue  # an output that stays where it is, as a settled speed does, can't show how long a gap is
        per_row += abs(change - row)
        per_time += abs(change - row * float(steps[k]) / typical)
        count += 1
    return count >= _SEVERAL and per_row < _LESS * per_time


def _bursts(data: Dataset, gaps: NDArray[np.int64]) -> Finding:
    t = data.t_input
    mean = float(t[-1] - t[0]) / (len(t) - 1)
    sentence = (
        f"{data.name}: over {len(gaps)} gaps of up to {np.diff(t).max():.3g} s the output changes no more than from one row to "
        "the next, so no rows are missing: they were read late and many at once, and their times are those of the reading. "
        f"If the samples were taken evenly, give the sample time, about {mean:.3g} s, with `sample_time=...` in place of the "
        "times."
    )
    rows = (int(gaps[0]) + 1, int(gaps[-1]) + 2)
    return warning("times-of-reading", sentence, parameters=("gain", "time_constant", "delay"), rows=rows)


def _may_have_changed(u: Array, k: int, rows: int) -> bool:
    """Whether the input is another one after the gap, or usually changes within so many rows.

    Where it changes a few times in all, it will hardly have changed in a gap and back again.
    """
    least = _CHANGED * float(np.ptp(u))
    span = min(rows, len(u) // 2)
    usual = float(np.mean(np.abs(u[span:] - u[:-span])))
    often = np.count_nonzero(np.diff(u)) * rows > _RARELY * len(u)
    return bool(abs(u[k + 1] - u[k]) > least or (often and usual > least))


def _is_rest(data: Dataset, k: int) -> bool:
    """Whether the input is the same on both sides of the gap behind row k, and a position as well: nothing moved the shaft."""
    begin, end = data.t_input[[k, k + 1]]
    after = int(np.searchsorted(data.t_output, 0.5 * (begin + end)))
    same = abs(data.u[k + 1] - data.u[k]) <= _CHANGED * float(np.ptp(data.u))
    if data.kind != "position" or not same or not 0 < after < len(data.y):
        return False
    return bool(abs(data.y[after] - data.y[after - 1]) <= data.noise)


def _scatter_finding(data: Dataset) -> list[Finding]:
    """A finding on scattered times, where the file's reader has none."""
    steps = np.diff(data.t_output)
    if len(steps) < 10 or any(finding.code == "time-uneven" for finding in data.findings):
        return []
    low, middle, high = (float(step) for step in np.percentile(steps, (1, 50, 99)))
    if high - low <= UNEVEN * middle:
        return []
    sentence = (
        f"{data.name}: the samples are unevenly spaced: the median sample time is {middle:.4g} s, "
        f"and 98 % of the steps lie between {low:.4g} s and {high:.4g} s. Each sample is used at "
        "its own time."
    )
    return [info("time-uneven", sentence)]


DOUBTS.member("gaps")(
    Doubt(codes=("gap-input-unknown", "time-uneven", "times-of-reading"), about_data=_about)
)

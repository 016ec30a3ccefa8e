"""The speeds that a motor settles at under constant inputs: what records say of gain and time constant before any fit.

A speed that has come to within a few percent of its end after half of the time T under an input has a time constant well below T:
the means of its last two quarters differ by a tenth of the way from the first quarter where T is 3.8 time constants. A bound of T
leaves out what a search may come to all the same, a motor so slow that it never settles, whose speed a nuisance start explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.models.motion import smooth_speed
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

_FEWEST = 8  # samples under one input
SETTLED = 0.05  # of the largest speed: what a settled one may still change by
_SETTLING = 0.1  # of the way to it: what changes by more goes on
_NOISE = 0.01  # of the largest speed: a change that may be noise
_NEARLY_ALL = 0.8  # of the stretches in which the speed plainly changes, and of the samples
_MOSTLY = 0.5  # of the time under constant inputs
_CALM = 0.25  # of the rate at which speeds change that haven't settled: by chance some of a flywheel's change by half of it
_INNER = np.arange(1.0, 4.0)  # the ends of quarters within a stretch
_PLAIN = 0.2  # of the largest speed: a change that shows how fast the speed settles


@dataclass(frozen=True, kw_only=True)
class SteadySpeed:
    """A `speed` that a motor settled at under a constant input `level`, in the units of the record.

    `change` is that of the speed since the first quarter of the time under the input, `level_before` the input before it, `time`
    [s] that of the last sample under it, and `drift` the rate of the speed in the second half of the time, in its unit a second.
    """

    level: float
    speed: float
    change: float
    level_before: float
    time: float
    drift: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Stretches:
    """Stretches under one input each: `times` [s] are how long they last, the others as in `SteadySpeed`; (S,) each.

    `settled` says which of the speeds settled, `ends` are the times of their last samples [s],
    `samples` is the number of samples in all of them, `largest` the largest speed of the whole record.
    """

    levels: Array
    speeds: Array
    changes: Array
    levels_before: Array
    times: Array
    ends: Array
    drifts: Array
    settled: NDArray[np.bool_]
    samples: int
    largest: float


def stretches_of_input(data: Dataset) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first sample of the output under each constant input, and the one after its last (S,)."""
    changes = np.flatnonzero(np.diff(data.input_at_output)) + 1
    return np.append(0, changes), np.append(changes, len(data.y))


def quarters(data: Dataset, first: int, end: int) -> list[slice]:
    """Return the samples of each quarter of the time from sample `first` to before `end`; none where one of them has no two."""
    t = data.t_output
    inner = np.searchsorted(t, t[first] + _INNER * ((t[end - 1] - t[first]) / 4))
    edges = [first, *(int(n) for n in inner), end]
    parts = [slice(a, b) for a, b in pairwise(edges)]
    return parts if all(part.stop - part.start >= 2 for part in parts) else []


def steady_speeds(data: Dataset) -> list[SteadySpeed]:
    """Return the speed of each stretch of a constant input in whose last half it hardly changes.

    It changes by 5 % of the largest speed at most, and by a tenth of the way to it if that is more than 1 % of the largest.
    Speeds are in the unit of the position a second, levels in that of the input; in the order of the record.
    """
    each = _stretches(data)
    return [
        SteadySpeed(
            level=float(each.levels[n]),
            speed=float(each.speeds[n]),
            change=float(each.changes[n]),
            level_before=float(each.levels_before[n]),
            time=float(each.ends[n]),
            drift=float(each.drifts[n]),
        )
        for n in np.flatnonzero(each.settled)
    ]


def speeds_by_level(records: Sequence[Dataset]) -> dict[float, float]:
    """Return the mean of the speeds that several records settled at under each level, the lowest level first; units as there.

    Where the input changes before the motor gets to its speed, some stretch looks settled by chance: a level counts where all of
    its stretches are, or several of them settled at the same speed. Where most don't settle, one that changes at a rate like
    theirs hasn't, either.
    """
    every = [_stretches(record) for record in records]
    levels, speeds, times, drifts, settled = (
        np.concatenate([getattr(each, name) for each in every])
        for name in ("levels", "speeds", "times", "drifts", "settled")
    )
    if times[settled].sum() < _MOSTLY * times.sum():
        settled &= np.abs(drifts) < _CALM * np.median(np.abs(drifts[~settled]))
    largest = max(each.largest for each in every)
    means = {}
    for level in np.unique(levels).tolist():
        at_level = levels == level
        own = speeds[at_level & settled]
        same = len(own) > 1 and np.ptp(own) <= SETTLED * largest
        if len(own) and (same or len(own) == np.count_nonzero(at_level)):
            means[level] = float(np.mean(own))
    return means


def longest_time_constant(records: Sequence[Dataset]) -> float:
    """Return the longest time constant [s] that settled speeds leave possible, infinite where they say nothing.

    They say something where the input mostly stays as it is and nearly all speeds that change settle, which isn't by chance of
    the noise then. Speeds that don't change at all say so only where none of any record does: then no record shows how a speed
    changes, and that each motor was by chance as fast as it is, so slow that this doesn't show, is no explanation.
    """
    return _longest_of_one(records[0]) if len(records) == 1 else _longest_of(records)


@keep_with_data
def _longest_of_one(record: Dataset) -> float:
    return _longest_of((record,))


def _longest_of(records: Sequence[Dataset]) -> float:
    every = [_stretches(record) for record in records]
    if sum(each.samples for each in every) < _NEARLY_ALL * sum(len(record.y) for record in records):
        return np.inf
    times = np.concatenate([each.times for each in every])
    changes = np.concatenate([np.abs(each.changes) for each in every])
    settled = np.concatenate([each.settled for each in every])
    largest = max(each.largest for each in every)
    plain = changes > _PLAIN * largest
    if plain.any():
        return float(times[plain & settled].max()) if np.mean(settled[plain]) >= _NEARLY_ALL else np.inf
    return float(times.max()) if largest > 0.0 and settled.all() else np.inf


@keep_with_data
def _stretches(data: Dataset) -> _Stretches:
    first, end = stretches_of_input(data)
    long = end - first >= _FEWEST
    first, end = first[long], end[long]
    half = first + (end - first) // 2
    mid = half + (end - half + 1) // 2
    began = _mean_speeds(data, first, first + (end - first) // 4)
    before, after = _mean_speeds(data, half, mid), _mean_speeds(data, mid, end)
    t, largest = data.t_output, float(np.abs(smooth_speed(data)).max(initial=0.0))
    # Two means of a position may differ by its steps alone.
    quantum = (data.quantum or 0.0) if data.kind == "position" else 0.0
    steps = 2.0 * quantum / (t[end - 1] - t[mid])
    change = np.abs(after - before) - steps
    goes_on = change > np.maximum(_SETTLING * np.abs(after - began), _NOISE * largest)
    u = np.append(data.input_before, data.input_at_output)  # one place later than the output
    return _Stretches(
        levels=u[end],
        speeds=_mean_speeds(data, half, end),
        changes=after - began,
        levels_before=u[first],
        times=t[end - 1] - t[first],
        ends=t[end - 1],
        drifts=(after - before) / (0.5 * (t[end - 1] - t[half])),
        settled=(np.maximum(change, steps) <= SETTLED * largest) & ~goes_on,
        samples=int(np.sum(end - first)),
        largest=largest,
    )


def _mean_speeds(data: Dataset, first: NDArray[np.int64], end: NDArray[np.int64]) -> Array:
    """The mean speeds (S,) from a `first` sample to before an `end` (S,): those of a position from its values there."""
    if data.kind == "speed":
        total = np.append(0.0, np.cumsum(data.y))
        return np.asarray((total[end] - total[first]) / (end - first))
    return np.asarray((data.y[end - 1] - data.y[first]) / (data.t_output[end - 1] - data.t_output[first]))

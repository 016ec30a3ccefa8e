"""The speeds that a motor settles at under constant inputs: what a record says of the gain before any model is fitted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.identification.models.motion import smooth_speed
from servobench.recordings.measurement.dataset import Dataset

_FEWEST = 8  # samples under one input
_SAME = 0.05  # of the largest speed: what a settled one may still change by
_SETTLING = 0.1  # of the way to it: what changes by more goes on
_NOISE = 0.01  # of the largest speed: a change that may be noise


@dataclass(frozen=True, kw_only=True)
class SettledSpeed:
    """A `speed` that a motor settled at under a constant input `level`, in the units of the record."""

    level: float
    speed: float


def settled_speeds(data: Dataset) -> list[SettledSpeed]:
    """Return the speed of each stretch of a constant input in whose last half it hardly changes.

    It changes by 5 % of the largest speed at most, and by a tenth of the way to it if that is more than 1 % of the largest. Speeds are in the unit of the position a second, levels in that of the input; in the order of the record.
    """
    largest = float(np.abs(smooth_speed(data)).max(initial=0.0))
    settled = []
    for rows in _stretches(data):
        if len(rows) < _FEWEST:
            continue
        first, third, last = (rows[: len(rows) // 4], *np.array_split(rows[len(rows) // 2 :], 2))
        began, before, after = (_mean_speed(data, part) for part in (first, third, last))
        change = abs(after - before)
        if change <= _SAME * largest and change <= max(_SETTLING * abs(after - began), _NOISE * largest):
            level = float(data.input_at_output[rows[-1]])
            settled.append(SettledSpeed(level=level, speed=_mean_speed(data, np.append(third, last))))
    return settled


def _stretches(data: Dataset) -> Iterator[NDArray[np.int64]]:
    """The samples of the output under one input after another."""
    changes = np.flatnonzero(np.diff(data.input_at_output)) + 1
    yield from np.split(np.arange(len(data.y)), changes)


def _mean_speed(data: Dataset, rows: NDArray[np.int64]) -> float:
    """The mean speed over rows that follow each other: that of a position from its ends."""
    if data.kind == "speed":
        return float(np.mean(data.y[rows]))
    first, last = rows[0], rows[-1]
    return float((data.y[last] - data.y[first]) / (data.t_output[last] - data.t_output[first]))

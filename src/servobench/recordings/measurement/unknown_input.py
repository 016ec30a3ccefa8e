"""Outputs that an input before the record may have driven: they are left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.first_motion import SUSTAINED

_UNKNOWN = (
    4  # samples that an input before the record may have driven: a delay of three, and one of the latch
)


_LATE = 0.01  # s; the same for loops that sample fast


_LEAST = 30  # samples that a record needs to spare some
_DRIVEN = 0.02  # of the largest input: below that it is the offset of a measurement


def without_unknown_input(data: Dataset) -> Dataset:
    """Return a record without the first outputs, which an input before the first row may have driven through a delay.

    So it is where the first row has an input already, which may have begun with that row or long before, where the shaft moves
    when the record begins, or sets off before the input changes. How long a delay may be nobody knows: four samples or 10 ms, but
    at most a fiftieth of the samples beyond the four, are left out. Where the input never changes there is nothing to be mistaken
    in, and a shaft that rests until it does was driven by nothing.
    """
    most = max(_UNKNOWN, len(data.y) // 50)
    late = int(np.count_nonzero(data.t_output < data.t_output[0] + _LATE))
    left_out = min(max(_UNKNOWN, late), most)
    if not np.ptp(data.u) > 0 or len(data.y) < _LEAST:
        return data
    driven = abs(data.u[0]) > _DRIVEN * float(np.abs(data.u).max())
    if not (driven or _moves_at_first(data, left_out) or _sets_off_unasked(data)):
        return data
    return replace(
        data,
        t_output=data.t_output[left_out:],
        y=data.y[left_out:],
        current=None if data.current is None else data.current[left_out:],
        rows=data.row_numbers(np.arange(left_out, len(data.y))),
    )


def _moves_at_first(data: Dataset, samples: int) -> bool:
    """Whether the shaft moves within so many samples by more than noise, or its speed isn't zero, before the input changes."""
    until = _rows_until_change(data)
    if data.kind == "speed":
        return abs(float(np.median(data.y[: min(until, max(samples, 3)) or 3]))) > data.noise
    if until < 2:
        return float(np.ptp(data.y[:samples])) > 2 * data.noise
    return float(np.ptp(data.y[: min(until, max(samples, 3))])) > data.noise


def _sets_off_unasked(data: Dataset) -> bool:
    """Whether a shaft that stood sets off before the input changes: what it answers to came with the first row, or before it."""
    until = _rows_until_change(data)
    stood = float(np.median(data.y[: min(until, SUSTAINED) or SUSTAINED]))
    away = np.flatnonzero(np.abs(data.y - stood) > data.noise)
    return bool(len(away) > 0 and away[0] < until)


def _rows_until_change(data: Dataset) -> int:
    """The outputs up to the first change of the input; a speed may answer within the row of the change."""
    return int(
        np.searchsorted(data.t_output, _change(data), side="left" if data.kind == "speed" else "right")
    )


def _change(data: Dataset) -> float:
    """The time [s] at which an input that isn't one value throughout first changes."""
    return float(data.t_input[np.flatnonzero(data.u != data.u[0])[0]])

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
_SILENT = 2  # rows of nothing at the least
_PART = 0.1  # of the record at the most
_NEXT = 20  # rows that show how much a speed changes from row to row
_AT_ONCE = 10.0  # times that
_STEP = 0.2  # of the input's range
_PLAIN = 0.05  # of the speed that is reached: a motion that is plain to see
_STANDS = 0.1  # of that: below it a shaft hasn't set off yet


def without_unknown_input(data: Dataset) -> Dataset:
    """Return a record without the first outputs, which an input before the first row may have driven through a delay.

    So it is where the first row has an input already, which may have begun with that row or long before, where the shaft moves
    when the record begins, or sets off before the input changes. How long a delay may be nobody knows: four samples or 10 ms, but
    at most a fiftieth of the samples beyond the four, are left out, and all in which the shaft stands although its input is on.
    A free start state has no such rest: it would take the rise for a slower one. Where the input never changes there is nothing
    else to be mistaken in, and a shaft that rests until it does was driven by nothing.
    """
    left_out = max(rows_standing(data), _rows_before_readings(data))
    if np.ptp(data.u) > 0:
        if len(data.y) < _LEAST:
            return data
        most = max(_UNKNOWN, len(data.y) // 50)
        late = int(np.count_nonzero(data.t_output < data.t_output[0] + _LATE))
        usual = min(max(_UNKNOWN, late), most)
        if not (_is_driven(data) or _moves_at_first(data, usual) or _sets_off_unasked(data)):
            return data
        left_out = max(left_out, usual)
    if not left_out:
        return data
    return replace(
        data,
        t_output=data.t_output[left_out:],
        y=data.y[left_out:],
        current=None if data.current is None else data.current[left_out:],
        rows=data.row_numbers(np.arange(left_out, len(data.y))),
    )


def rows_standing(data: Dataset) -> int:
    """Return the number of first outputs in which the shaft stands under an input that then moves it.

    A position has to move by several of the sensor's steps from row to row, or rest and slow motion look alike.
    """
    until = _rows_until_change(data) if np.ptp(data.u) > 0 else len(data.y)
    way = np.abs(data.y[:until] if data.kind == "speed" else np.diff(data.y[:until]))
    if not _is_driven(data) or len(way) < SUSTAINED:
        return 0
    plain = _PLAIN * float(np.median(way[len(way) // 2 :]))
    coarse = data.kind == "position" and plain < 0.5 * (data.quantum or 0.0)
    moves = np.flatnonzero(way > plain)
    if coarse or not len(moves):
        return 0
    standing = int(np.flatnonzero(way > _STANDS * way[moves[0]])[0])
    if moves[0] >= 2 * standing:
        return 0  # the first rows of a gradual rise
    return standing + 1 if standing and data.kind == "position" else standing


def _rows_before_readings(data: Dataset) -> int:
    """The number of first outputs in which a speed reads zero before it is at once what it goes on to be, as a sensor begins.

    No step of the input makes it so, nor does a shaft that breaks away, whose speed goes on to rise.
    """
    moves = np.flatnonzero(data.y)
    if data.kind != "speed" or not len(moves) or not _SILENT <= moves[0] <= _PART * len(data.y):
        return 0
    first = int(moves[0])
    steps = np.abs(np.diff(data.y[first : first + _NEXT]))
    at_once = (
        abs(float(data.y[first])) > _AT_ONCE * float(np.median(steps)) if len(steps) >= SUSTAINED else False
    )
    earlier = data.u[data.t_input <= data.t_output[first]]
    stepped = float(np.abs(np.diff(earlier, prepend=data.input_before)).max(initial=0.0)) > _STEP * float(
        np.ptp(data.u)
    )
    plain = abs(float(data.y[first])) > _PLAIN * float(np.abs(data.y).max())
    return first if at_once and plain and not stepped and _is_driven(data) else 0


def _is_driven(data: Dataset) -> bool:
    return bool(abs(data.u[0]) > _DRIVEN * float(np.abs(data.u).max()))


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

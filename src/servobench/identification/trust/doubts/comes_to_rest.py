"""A shaft that leaves its rest when the input changes, and rests again while the input stays: no constant voltage does that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.steady import quarters, stretches_of_input
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.goal import OF_A_SHAFT
from servobench.recordings.measurement.dataset import Dataset

_FEW = 12  # samples under one input
_BEFORE = 3  # samples of rest, and a quarter of the time under the input, unless the record's outputs begin later than its inputs
_SETS_OFF = 1.2  # times as fast as before the input changed: a shaft that coasts gets slower and slower
_RESTED = 0.15  # of the way: what a shaft at rest may seem to have moved by, the noise of a servo's own sensor included
_STANDS = 0.05  # of the way, from one quarter to the next: at a steady speed it is a quarter
_NOISY = 0.2  # of the way: what all readings at rest may differ by
_CLEAR = 8.0  # times the noise at rest
_COUNTS = 5.0  # of the encoder
_MUCH = 0.5  # of the largest input, or of all the way: under less a jerk may end in the friction that it set off from


@dataclass(frozen=True, kw_only=True)
class _Move:
    """A way of the shaft from rest to rest under one input, rows `first` to before `end`; it is nearly over at row `arrived`."""

    first: int
    arrived: int
    end: int


def _about(fit: Fit) -> list[Finding]:
    if fit.structure.startswith("position_loop") or any(
        name.startswith("gravity") for name in fit.model.names
    ):
        return []  # the model has what stops it
    return [finding for record in fit.records for finding in _of(record.data)]


def _of(data: Dataset) -> list[Finding]:
    """The finding on the longest stay, where there is one."""
    if data.input_unit in OF_A_SHAFT:
        return []
    moves = _moves(data)
    if not moves:
        return []
    move = max(moves, key=lambda each: each.end - each.arrived)
    t = data.t_output
    level = with_unit(float(data.input_at_output[move.first]), data.input_unit, 3)
    moved, stood = (
        with_unit(float(each), "s", 2)
        for each in (t[move.arrived] - t[move.first], t[move.end - 1] - t[move.arrived])
    )
    sentence = (
        f"{data.name}: when the input changes to {level} the shaft moves for {moved}, and then stands for {stood} although the "
        "input stays: no constant input does that to a motor. The input is the target of a position loop, as a servo has one, or "
        "a stop, a spring or a weight holds the shaft. Record what drives the motor, and let it turn freely."
    )
    rows = data.row_span(move.arrived, move.end - 1)
    return [
        warning("shaft-comes-to-rest", sentence, parameters=("gain", "time_constant", "delay"), rows=rows)
    ]


def _moves(data: Dataset) -> list[_Move]:
    position = data.y if data.kind == "position" else _way(data)
    u = data.input_at_output
    stretches = [
        (int(first), int(end))
        for first, end in zip(*stretches_of_input(data), strict=True)
        if first > 0 and end - first >= _FEW and u[first] != 0.0
    ]
    moves = [_move(data, position, *each) for each in stretches]
    return [move for move in moves if move is not None and _is_large(move, u, position)]


def _is_large(move: _Move, u: Array, position: Array) -> bool:
    way = abs(float(position[move.end - 1] - position[move.first - 1]))
    return bool(abs(u[move.first]) >= _MUCH * np.abs(u).max() or way >= _MUCH * np.ptp(position))


def _way(data: Dataset) -> Array:
    """The way (M,) since the first sample of a measured speed, in the unit of the position."""
    steps = 0.5 * (data.y[1:] + data.y[:-1]) * np.diff(data.t_output)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _move(data: Dataset, position: Array, first: int, end: int) -> _Move | None:
    t, parts = data.t_output, quarters(data, first, end)
    since = int(np.searchsorted(t, t[first] - (t[end - 1] - t[first]) / 4))
    before, under = position[min(since, max(first - _BEFORE, 0)) : first], position[first:end]
    if not parts or (len(before) < _BEFORE and data.t_input[0] >= t[first - 1]):
        return None  # too few samples, or it isn't known that the input changes here
    third, last = (float(position[part].mean()) for part in parts[2:])
    way, rest = abs(last - float(before.mean())), position[parts[2].start : end]
    stands = abs(last - third) <= _STANDS * way and np.ptp(rest) <= _NOISY * way
    if not (stands and way > max(_CLEAR * float(np.std(rest)), _COUNTS * (data.quantum or 0.0))):
        return None
    rested = np.ptp(before) <= _RESTED * way and _sets_off(
        t[first - len(before) : end], position[first - len(before) : end], len(before)
    )
    if not rested:
        return None
    far = np.flatnonzero(np.abs(under - last) > _RESTED * way)
    return _Move(first=first, arrived=first + (int(far[-1]) + 1 if len(far) else 0), end=end)


def _sets_off(t: Array, position: Array, before: int) -> bool:
    """Whether a shaft (N,) becomes faster after its first samples; one that coasts on into the friction of a level is slower.

    Of a single sample before, the first step under the input says how fast it was.
    """
    pace = np.abs(np.diff(position)) / np.diff(t)
    return bool(pace[before - 1 :].max() > _SETS_OFF * pace[max(before - 2, 0)])


DOUBTS.member("comes_to_rest")(Doubt(codes=("shaft-comes-to-rest",), about_fit=_about))

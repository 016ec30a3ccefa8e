"""A shaft that turns and then stands, or turns the other way, under an input that never changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.core.runs import runs
from servobench.identification.models.motion import directions, smooth_speed, smoothing_span
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_FEW, _PART = 8, 0.1  # samples, and of the record: the shortest stretch of steady motion
_STEADY = 0.3  # of its median: the middle half of the speeds of a steady motion; half a sine's is 0.76
_STANDS, _STILL_FAST = 0.1, 0.5  # of the steady speed: a shaft that stands, and one that turns
_ABRUPT, _FEWEST_AT_REST = 3, 5  # samples: from one to the other at most, and at rest afterwards
_CLEAR = 4.0  # times the noise: a way that is seen
_AS_FAST = 0.3  # of the faster motion: a slower one may be a spring or a weight that gives way


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _of(record)]


def _of(data: Dataset) -> list[Finding]:
    """Whether a record whose input is one value, not zero, has steady motion, and then none or one the other way."""
    if len(data.y) < 2 * _FEW or np.ptp(data.u) > 0 or data.u[0] == 0:
        return []
    if data.input_unit in (data.position_unit, data.output_unit):
        return []  # a goal: a servo goes there, and back to the next one
    speed, senses = smooth_speed(data), directions(data)
    ways = [way for way in (_longest(senses == sense) for sense in (1.0, -1.0)) if _is_steady(speed, way)]
    if len(ways) == 2:
        return _reversal(data, speed, *sorted(ways, key=lambda way: int(way[0])))
    return _end_stop(data, speed, ways[0]) if ways else []


def _reversal(
    data: Dataset, speed: Array, first: NDArray[np.int64], second: NDArray[np.int64]
) -> list[Finding]:
    before, after = (float(np.median(speed[way])) for way in (first, second))
    if min(abs(before), abs(after)) < _AS_FAST * max(abs(before), abs(after)):
        return []
    turned, last = (data.in_seconds(data.t_output[k]) for k in (second[0], first[-1]))
    sentence = (
        f"{data.name}: from {turned} on the shaft turns the other way, at {_speed_text(data, after)} after "
        f"{_speed_text(data, before)}, although the input stays at {with_unit(float(data.u[0]), data.input_unit, 3)}: a motor "
        "doesn't do that by itself. The input changed its sign and the file doesn't say so, or the shaft came to an end stop. "
        f"Record the input with its sign, or use only the rows up to {last}."
    )
    rows = data.row_span(int(second[0]), int(second[-1]))
    return [warning("motion-reversed", sentence, parameters=("gain", "time_constant"), rows=rows)]


def _end_stop(data: Dataset, speed: Array, way: NDArray[np.int64]) -> list[Finding]:
    """Whether the shaft stands at the end, and came to rest within a few samples: it has no reason to under the same input."""
    before = float(np.median(speed[way]))
    at = _rest_of_position(data, before) if data.kind == "position" else _rest_of_speed(speed, before)
    if at is None or len(speed) - at < _FEWEST_AT_REST or at - int(way[-1]) > max(_FEW, smoothing_span(data)):
        return []
    way = way[way < at]
    if not len(way):
        return []
    stopped, last = (data.in_seconds(data.t_output[k]) for k in (at, way[-1]))
    sentence = (
        f"{data.name}: from {stopped} on the shaft stands, after {_speed_text(data, before)}, although the input stays at "
        f"{with_unit(float(data.u[0]), data.input_unit, 3)}: the shaft came to an end stop, or the amplifier was switched off. "
        f"Use only the rows up to {last}."
    )
    rows = data.row_span(at, len(speed) - 1)
    return [warning("motion-stopped", sentence, parameters=("gain", "time_constant"), rows=rows)]


def _rest_of_speed(speed: Array, before: float) -> int | None:
    """The sample from which on a speed (M,) stands that was `before` a few samples earlier; None where it is none."""
    moves = np.flatnonzero(np.abs(speed) > _STANDS * abs(before))
    fast = np.flatnonzero(np.abs(speed) > _STILL_FAST * abs(before))
    at = int(moves[-1]) + 1
    return at if at - int(fast[-1]) <= _ABRUPT else None


def _rest_of_position(data: Dataset, before: float) -> int | None:
    """The same of a position, whose smoothed speed takes long to show it: noise hides only the last bit of the way."""
    end = float(np.median(data.y[-_FEWEST_AT_REST:]))
    off = np.abs(data.y - end)
    away = np.flatnonzero(off > data.noise)
    at = int(away[-1]) + 1 if len(away) else 0
    if at == 0 or at == len(off):
        return None
    t, hidden = data.t_output, _CLEAR * data.noise
    began = int(np.searchsorted(t, t[at] - _ABRUPT * data.sample_time - hidden / abs(before)))
    is_abrupt = off[began] >= _STILL_FAST * abs(before) * (t[at] - t[began])
    return at if is_abrupt and abs(before) * (t[-1] - t[at]) >= hidden else None


def _speed_text(data: Dataset, speed: float) -> str:
    return with_unit(speed, data.output_unit if data.kind == "speed" else f"{data.position_unit}/s", 3)


def _longest(such: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The indices (K,) of the longest run of samples (M,) that are such."""
    return np.arange(*max(runs(such), key=lambda run: run[1] - run[0], default=(0, 0)))


def _is_steady(speed: Array, way: NDArray[np.int64]) -> bool:
    """Whether a stretch of a motion is long enough, and its speed stays about the same."""
    if len(way) < max(_FEW, _PART * len(speed)):
        return False
    low, middle, high = np.percentile(np.abs(speed[way]), (25, 50, 75))
    return bool(high - low < _STEADY * middle)


DOUBTS.member("motion_reversed")(Doubt(codes=("motion-reversed", "motion-stopped"), about_data=_about))

"""A constant input, at which the motor just keeps turning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.finding import Finding, refusal
from servobench.core.rounding import with_unit
from servobench.identification.models.motion import smooth_speed, steady_speed
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_UNSTEADY = 0.3  # of the last speed: what it may vary by
_FEWEST = 10  # samples
_BEHIND = 5.0  # steps of the sensor, or standard deviations about the line
_RESTED = ", or say `starts_at_rest=True` if the motor was at rest, without an input, until the record began"
_SLOWER = 0.75  # of the last speed: what the motor begins with where it still has to get there


def _input_constant(records: Sequence[Dataset]) -> list[Finding]:
    """Whether the input ever changes, from one record to the next is enough, or the motor gets to its speed meanwhile."""
    levels = np.concatenate([np.append(record.u, record.input_before) for record in records])
    if np.ptp(levels) > 0 or (levels[0] != 0 and any(map(_gets_to_speed, records))):
        return []
    sentence = f"The input stays at {levels[0]:g} {records[0].input_unit} throughout, {_consequence(records, levels[0])}."
    return [refusal("input-constant", sentence, parameters=("gain", "coulomb_voltage"))]


def _consequence(records: Sequence[Dataset], level: float) -> str:
    """What an input that never changes leaves open, and what to do."""
    if level == 0.0 and any(np.ptp(record.y) > 0 for record in records):
        return (
            "which doesn't show what it does; record steps between at least two levels. If the motor was coasting here, give "
            "this together with a recording in which it is driven; if something else drove it, this is the wrong column"
        )
    separable = "so gain and friction can't be separated; record steps between at least two levels"
    return f"{_at_speed(records)}{separable}{_RESTED if level else ''}"


def _at_speed(records: Sequence[Dataset]) -> str:
    """The speed of a motor that keeps turning at one, which is what such a record does tell."""
    speed = steady_speed(records[0])
    if speed is None or len(records) > 1:
        return ""
    return f"and the motor turns at {with_unit(speed, f'{records[0].position_unit}/s', 4)}, "


def _gets_to_speed(record: Dataset) -> bool:
    """Whether the shaft gets to its speed while the record lasts, and is steady in its last half."""
    if len(record.y) < _FEWEST:
        return False
    return _is_slower(record) or (record.kind == "position" and _falls_behind(record))


def _falls_behind(record: Dataset) -> bool:
    """Whether a position begins ahead of the line that it ends on, by more than chance."""
    t, y, half = record.t_output, record.y, len(record.y) // 2
    speed, start = np.polyfit(t[half:] - t[0], y[half:], 1)
    left = float(np.std(y[half:] - start - speed * (t[half:] - t[0])))
    return bool((y[0] - start) * np.sign(speed) > _BEHIND * max(left, record.quantum or 0.0))


def _is_slower(record: Dataset) -> bool:
    """Whether a speed is a quarter less in the first tenth of a record than in its last half, over which it varies by little."""
    speed = np.abs(smooth_speed(record))
    slow, steady, fast = np.percentile(speed[len(speed) // 2 :], (5, 50, 95))
    first = speed[: max(len(speed) // 10, 1)].min()
    return bool(first < _SLOWER * steady and fast - slow < _UNSTEADY * steady)


DOUBTS.member("input_constant")(Doubt(codes=("input-constant",), about_data=_input_constant))

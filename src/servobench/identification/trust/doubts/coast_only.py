"""A record that shows nothing but a coast, or a motor that slows down: a driver that lets go of it makes another one of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.identification.models.level import HARDLY_CONDUCTS
from servobench.identification.models.motion import smooth_speed
from servobench.identification.models.steady import steady_speeds
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.resting_value import is_duty
from servobench.recordings.measurement.dataset import Dataset

_FIRST = 8  # rows, in which a change shows nothing
_STARTS = 0.5  # of the speed: what is slower in the first rows sets off there
_STEADY = 0.1  # of the speed: what one may change by before the duty ends


def _about(records: Sequence[Dataset]) -> list[Finding]:
    if not all(is_duty(record) and _only_slows_down(record) for record in records):
        return []
    if not all(map(_only_coasts, records)):
        sentence = (
            "The speed changes only where the duty falls. Many bridges let go of a motor between the pulses instead of braking "
            "it, so that it slows down more slowly than it speeds up, up to three times: the time constant is that of slowing "
            "down. Record a step up as well."
        )
        return [info("slows-down-only", sentence, parameters=("time_constant",))]
    sentence = (
        "The speed changes only after the duty has become zero, or next to zero. Many drivers let go of a motor there instead of "
        "braking it; it then coasts, and takes far longer than it does to follow a duty: the time constant is that of the coast. "
        "Record a step under power as well."
    )
    return [warning("coast-only", sentence, parameters=("time_constant", "gain", "coulomb_voltage"))]


def _only_coasts(record: Dataset) -> bool:
    """Whether an input that only falls does so once, to next to zero."""
    levels = _levels(record)
    return len(levels) == 2 and abs(float(levels[-1])) <= _next_to_zero(record)


def _only_slows_down(record: Dataset) -> bool:
    """Whether the input falls towards zero while the speed is steady, and changes nowhere else but in the first rows."""
    levels, least = _levels(record), _next_to_zero(record)
    if len(levels) < 2 or record.starts_at_rest:
        return False
    falls = np.all(np.diff(np.abs(levels)) < 0.0)
    turns_round = np.any((levels * levels[0] < 0.0) & (np.abs(levels) > least))
    before = [each for each in steady_speeds(record) if abs(each.level) > least]
    if not falls or turns_round or not before or before[0].level != levels[0]:
        return False
    speed = abs(before[0].speed)
    slowest = float(np.abs(smooth_speed(record)[:_FIRST]).min())  # a start under power is another event
    return abs(before[0].change) <= _STEADY * speed and slowest >= _STARTS * speed


def _levels(record: Dataset) -> Array:
    """The levels (L,) of the input from the first rows on, in their order; none where it doesn't change any more."""
    changes = np.flatnonzero(np.diff(record.u)) + 1
    later = changes[changes >= _FIRST]
    return record.u[np.append(later[0] - 1, later)] if len(later) else record.u[:0]


def _next_to_zero(record: Dataset) -> float:
    """The largest duty at which a driver conducts next to never, in the unit of the input."""
    return HARDLY_CONDUCTS * float(np.abs(record.u).max(initial=0.0))


DOUBTS.member("coast_only")(Doubt(codes=("coast-only", "slows-down-only"), about_data=_about))

"""A record that shows nothing but a coast: a driver that lets go of the motor at zero duty makes another one of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.finding import Finding, warning
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
    if not all(is_duty(record) and _only_coasts(record) for record in records):
        return []
    sentence = (
        "The speed changes only after the duty has become zero, or next to zero. Many drivers let go of a motor there instead of "
        "braking it; it then coasts, and takes far longer than it does to follow a duty: the time constant is that of the coast. "
        "Record a step under power as well."
    )
    return [warning("coast-only", sentence, parameters=("time_constant", "gain", "coulomb_voltage"))]


def _only_coasts(record: Dataset) -> bool:
    """Whether the input falls to next to zero while the speed is steady, and changes nowhere else but in the first rows."""
    changes = np.flatnonzero(np.diff(record.u)) + 1
    later = changes[changes >= _FIRST]
    least = HARDLY_CONDUCTS * float(np.abs(record.u).max(initial=0.0))
    if len(later) != 1 or abs(record.u[-1]) > least:
        return False
    before = [each for each in steady_speeds(record) if abs(each.level) > least]
    if len(before) != 1 or record.starts_at_rest:
        return False
    speed = abs(before[0].speed)
    slowest = float(np.abs(smooth_speed(record)[:_FIRST]).min())  # a start under power is another event
    return abs(before[0].change) <= _STEADY * speed and slowest >= _STARTS * speed


DOUBTS.member("coast_only")(Doubt(codes=("coast-only",), about_data=_about))

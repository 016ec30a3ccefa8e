"""A shaft that is said to be at rest when the record begins, and turns already."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.models.steady import steady_speeds, stretches_of_input
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_COUNTS = 20.0  # of the sensor, in a window: it then shows a twentieth of the speed
_LACKS = 0.1  # of the settled speed, in the first window: less may be nothing
_FAR = 0.5  # of what a motor from rest lacks of its speed in the first window
_LAG = 0.002, 0.01  # s: the shortest lag of a servo motor, and one that a coarse sensor has to show
_FIRST = 5  # steps from sample to sample, the largest of which is what the motor gains in one
_AHEAD = 2.0  # of these steps: from rest a shaft can't be as fast in the first sample


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [_finding(record) for record in records if isnt_at_rest(record)]


def isnt_at_rest(data: Dataset) -> bool:
    """Return whether a record that is said to start at rest starts faster than any motor does from rest.

    A speed is higher at once than a motor gets to in two samples; a position as `_starts_too_fast` says.
    """
    if not data.starts_at_rest or len(data.y) <= _FIRST:
        return False
    if data.kind == "position":
        return _starts_too_fast(data)
    gained = float(np.abs(np.diff(data.y[: _FIRST + 1])).max())
    return bool(abs(data.y[0]) > max(_AHEAD * gained, data.noise))


def _starts_too_fast(data: Dataset) -> bool:
    """Whether a position goes on under its first level as from another speed than zero.

    In two windows of w seconds a motor from rest lacks, of the speed v that it settles at, the parts

        a = τ/w (1 - q)   and   q a,   q = exp(-w/τ),

    and more behind a delay. So q = b/a tells what a has to be, if b is what it lacks in the second. Where it lacks nothing,
    τ + delay = a w is shorter than that of any servo motor, or than a count takes.
    """
    first = next(iter(steady_speeds(data)), None)
    if first is None:
        return False
    starts, ends = stretches_of_input(data)
    at = int(np.flatnonzero(ends - starts > 1)[0])
    # The first sample under an input ends the time in which that acts; it begins with the one before.
    start, end = max(int(starts[at]) - 1, 0), int(ends[at])
    if first.time != data.t_output[end - 1]:
        return False
    pace = abs(first.speed) or np.inf
    count = (data.quantum or 0.0) / pace  # s
    window = int(np.ceil(max(_COUNTS * count, data.noise / pace) / data.sample_time))
    places = start + window * np.arange(3)
    if window < 1 or places[-1] >= end:
        return False
    times = np.diff(data.t_output[places])
    a, b = (1.0 - np.diff(data.y[places]) / times / first.speed).tolist()
    shortest, longest = _LAG
    # In a window as short as that itself a motor from rest lacks nearly all of its speed.
    if a < _FAR and data.sample_time <= longest and a * times[0] < min(max(shortest, count), longest):
        return True
    return bool(_LACKS < b < a and a < _FAR * (1.0 - b / a) / np.log(a / b))


def _finding(data: Dataset) -> Finding:
    first = with_unit(float(data.y[0]), data.output_unit, 3)
    how = (
        "the shaft has a speed at once that no motor gets to so soon"
        if data.kind == "position"
        else f"its first speed is {first}: the shaft turned before"
    )
    sentence = (
        f"{data.name}: `starts_at_rest=True` says that the record starts at rest, but {how}. Leave that out, or give the rows "
        "from before the start as well."
    )
    return warning("not-at-rest", sentence, parameters=("delay", "time_constant"))


DOUBTS.member("rest_claimed")(Doubt(codes=("not-at-rest",), about_data=_about))

"""The judge of intervals: what one recording of a motor says, its other recordings must bear out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from real_parts.runs import PARAMETERS, Outcome

ENOUGH = 3  # recordings of a motor, so that each is judged by two others at least
_NORMAL = 1.4826  # the standard deviation of a normal distribution over its median absolute deviation


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One parameter of one motor: how often a recording's interval holds the median of the others.

    `scatter` is the standard deviation between recordings (from the median absolute deviation), relative to `consensus`, the
    median of all. `width` is the median half-width over that standard deviation.
    """

    motor: str
    parameter: str
    stated: int
    held: int
    consensus: float
    scatter: float
    width: float


def judged(outcomes: Sequence[Outcome]) -> tuple[Judged, ...]:
    """Return the judgement of each parameter of each motor that at least three of its recordings state."""
    motors = dict.fromkeys(outcome.motor for outcome in outcomes)
    found = (
        _judged(motor, parameter, [each for each in outcomes if each.motor == motor])
        for motor in motors
        for parameter in PARAMETERS
    )
    return tuple(each for each in found if each is not None)


def _judged(motor: str, parameter: str, outcomes: Sequence[Outcome]) -> Judged | None:
    stated = [each.stated[parameter] for each in outcomes if parameter in each.stated]
    if len(stated) < ENOUGH:
        return None
    values = [each.value for each in stated]
    consensus = median(values)
    sd = _NORMAL * median(abs(value - consensus) for value in values)
    return Judged(
        motor=motor,
        parameter=parameter,
        stated=len(stated),
        held=sum(one.holds(median(values[:n] + values[n + 1 :])) for n, one in enumerate(stated)),
        consensus=consensus,
        scatter=sd / abs(consensus) if consensus else math.nan,
        width=median(each.half_width for each in stated) / sd if sd else math.inf,
    )

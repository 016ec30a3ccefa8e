"""The judge of intervals: what one recording of a motor says, its other recordings must bear out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import fmean, median, stdev

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


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """The scatter of one parameter over the recordings of one family of motors, whatever they state about themselves.

    `own` is the relative standard deviation within a motor, the root mean square over the family's motors; `others` the median of
    that of the other families, which is what experience would have been without this one.
    """

    family: str
    parameter: str
    own: float
    others: float


def scatter_of_families(outcomes: Sequence[Outcome], parameter: str) -> tuple[Scatter, ...]:
    """Return the scatter of each family, a folder of recordings, in which a motor has two that state the parameter."""
    motors: dict[tuple[str, str], list[float]] = {}
    for each in outcomes:
        if parameter in each.stated:
            of = (each.name.split("/")[0], each.motor)
            motors.setdefault(of, []).append(abs(each.stated[parameter].value))
    squares: dict[str, list[float]] = {}
    for (family, _), values in motors.items():
        if len(values) > 1:
            squares.setdefault(family, []).append((stdev(values) / fmean(values)) ** 2)
    own = {family: math.sqrt(fmean(each)) for family, each in squares.items()}
    return tuple(
        Scatter(
            family=family,
            parameter=parameter,
            own=value,
            others=median([other for name, other in own.items() if name != family]),
        )
        for family, value in own.items()
        if len(own) > 1
    )

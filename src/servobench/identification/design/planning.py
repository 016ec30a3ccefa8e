"""The verb design: from the knowledge of a motor, and limits, to the most informative experiment.

The design of experiments by the information they give is that of Goodwin and Payne, Dynamic System Identification (1977).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack, get_args

from servobench.core.arguments import check_type
from servobench.core.errors import UnknownName, UsageError
from servobench.core.units import quantity
from servobench.identification.design.assumed_motor import AssumedMotor, from_data_sheet, from_result
from servobench.identification.design.limits import DesignLimits
from servobench.identification.design.search import Design, Wish, best_design
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.reading import ReadingOptions

_UNITS = {"voltage": "V", "current": "A", "speed": "rad/s", "travel": "rad"}


def design(
    data: object = None,
    *,
    limits: Mapping[str, float | str],
    nominal: str | None = None,
    duration: float | str = 10.0,
    experiment_sample_time: float | str = 0.002,
    wish: Wish = "both",
    starts_at_rest: bool = False,
    **options: Unpack[ReadingOptions],
) -> Design:
    """Return the experiment with the smallest predicted interval that keeps the motor inside the limits.

    The motor is given as a `Result`, or as data to identify first, read as by `identify`; without either it
    is the data sheet `nominal`, or `qube_servo_2`, within 20 %. `limits` are the largest voltage [V], current
    [A], speed [rad/s] and travel [rad] in each direction, each a number or a text such as "4 rev"; the
    voltage is required. `duration` [s] and `experiment_sample_time` [s] belong to the experiment. `wish`
    selects the interval to minimise: "gain", "time_constant" or "both". The other arguments are those of
    `best_design`. Raises `UsageError` for impossible arguments, and what `identify` and `best_design` raise.

    >>> found = design(limits={"voltage": 6, "travel": "4 rev"}, duration=2, experiment_sample_time="5 ms")
    >>> found.chosen.used["travel"] <= 1
    True
    """
    check_type("starts_at_rest", starts_at_rest, bool, "True or False")
    check_type("wish", wish, str, "a text")
    if wish not in get_args(Wish):
        raise UsageError(f"wish is {wish!r}; expected {' or '.join(map(repr, get_args(Wish)))}")
    design_limits = _limits(limits)
    length, step = _in("duration", duration, "s"), _in("experiment_sample_time", experiment_sample_time, "s")
    if data is not None or "u" in options:
        if nominal is not None:
            raise UsageError("data and nominal both describe the motor; give only one of them")
        return best_design(_motor_of(data, starts_at_rest, options), design_limits, length, step, wish)
    if options:
        raise UsageError(f"{', '.join(options)}: for use with data only; give data, or leave this out")
    return best_design(from_data_sheet(nominal or "qube_servo_2"), design_limits, length, step, wish)


def _motor_of(data: object, starts_at_rest: bool, options: Any) -> AssumedMotor:
    if isinstance(data, Result):
        if options:
            raise UsageError(f"data is a Result already: leave {', '.join(options)} out")
        return from_result(data, "the result")
    result = identify(data, starts_at_rest=starts_at_rest, **options)
    return from_result(result, result.data[0].name if result.data else "the data")


def _limits(limits: Mapping[str, float | str]) -> DesignLimits:
    """The limits in SI units; raises `UsageError` for one that isn't known, and without a voltage."""
    if not isinstance(limits, Mapping) or "voltage" not in limits:
        raise UsageError(
            f'limits is {limits!r}; expected a dict with a voltage, such as {{"voltage": 6, "travel": "4 rev"}}'
        )
    for name in limits:
        if name not in _UNITS:
            raise UnknownName("limit", str(name), _UNITS)
    return DesignLimits(
        **{name: _in(f"limits[{name!r}]", value, _UNITS[name]) for name, value in limits.items()}
    )


def _in(name: str, value: float | str, unit: str) -> float:
    try:
        return quantity(value, unit)
    except UsageError as error:
        raise type(error)(f"{name}: {error}") from None

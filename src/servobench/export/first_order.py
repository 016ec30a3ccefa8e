"""The first-order motor in a result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.errors import UnitError, UsageError
from servobench.core.estimate import Estimate
from servobench.core.rounding import TWO_SIDED
from servobench.core.units import convert, is_unit, unit
from servobench.export.summary import ResultSummary
from servobench.systems.first_order import FirstOrderMotor, scale_estimate


def first_order_motor(
    answer: ResultSummary, target: str, position_unit: str | None = None, wheel_diameter: float | None = None
) -> FirstOrderMotor:
    """Return the motor in an answer; `target` is what messages call the form that asks for it.

    Positions are in `position_unit`, by default the answer's; in one of length for an angle where a `wheel_diameter` [m] is given
    or the file said what a turn moves. Friction that differs by direction is its mean, and an offset.

    Raises `UsageError` where the answer is of another structure or its input no voltage, or the unit doesn't fit.
    """
    estimates = answer.estimates
    if not {"gain", "time_constant"} <= estimates.keys() or len(answer.transfer_function.denominator) > 2:
        raise UsageError(
            f"{target} takes a first-order motor (gain and time constant), and this result has the structure "
            f"{answer.structure}; identify with `structure=first_order_coulomb`"
        )
    position, driven_by = answer.units
    if driven_by != "V":
        raise UsageError(
            f"{target} takes a motor driven by a voltage, and the input of this result is in {driven_by}; identify with the "
            "voltage as the input (duty times supply)"
        )
    target_unit = position_unit or ("m" if wheel_diameter else position)
    factor = _factor(answer, target_unit, wheel_diameter)
    friction, offset = _friction(answer)
    rows = [list(estimates).index(name) for name in ("gain", "time_constant")]
    moments = np.zeros((3, 3))
    known = [*rows, list(estimates).index("delay")] if "delay" in estimates else rows
    moments[: len(known), : len(known)] = answer.covariance[np.ix_(known, known)]
    scale = np.array([factor, 1.0, 1.0])
    return FirstOrderMotor(
        unit=target_unit,
        gain=scale_estimate(estimates["gain"], factor, f"{target_unit}/(s·V)"),
        time_constant=estimates["time_constant"],
        delay=max(answer.transfer_function.delay, 0.0),
        coulomb_voltage=friction,
        offset_voltage=offset,
        one_way="one_way" in answer.structure,
        moments=moments * np.outer(scale, scale),
        doubtful=answer.verdict == "doubtful",
        cautions=answer.cautions,
    )


def comment_for(motor: FirstOrderMotor, answer: ResultSummary) -> tuple[str, ...]:
    """Return what a file with gains for this motor should say: they allow for its delay as estimated, below zero for none."""
    return answer.comment if motor.delay else answer.model_comment


def _friction(answer: ResultSummary) -> tuple[Estimate | None, Estimate | None]:
    """Coulomb friction and offset; where friction differs by direction, half of the sum and half of the difference."""
    estimates, names = answer.estimates, list(answer.estimates)
    pair = ("coulomb_voltage_forward", "coulomb_voltage_backward")
    if not estimates.keys() >= set(pair):
        return estimates.get("coulomb_voltage"), estimates.get("offset_voltage")
    rows = [names.index(name) for name in pair]
    moments = answer.covariance[np.ix_(rows, rows)]
    halves = []
    for sign in (1.0, -1.0):
        weights = np.array([0.5, 0.5 * sign])
        value = float(weights @ [estimates[name].value for name in pair])
        sd = float(np.sqrt(max(weights @ moments @ weights, 0.0)))
        ends = (value - TWO_SIDED * sd, value + TWO_SIDED * sd)
        halves.append(replace(estimates[pair[0]], value=value, sd=sd, interval=ends))
    return halves[0], halves[1]


def _factor(answer: ResultSummary, target_unit: str, wheel_diameter: float | None) -> float:
    """The factor from the result's unit of position to the wanted one."""
    position = answer.units[0]
    if position == target_unit and wheel_diameter is None:
        return 1.0
    try:
        if unit(target_unit).quantity != "position":
            raise UnitError(f"{target_unit} isn't a unit of position")
        if wheel_diameter is not None:
            return _by_wheel(position, target_unit, wheel_diameter)
        if answer.user_unit is not None and unit(target_unit).si != unit(position).si:
            symbol, factor = answer.user_unit
            return factor * convert(1.0, symbol, target_unit)
        return convert(1.0, position, target_unit)
    except UnitError as error:
        hint = ""
        if is_unit(target_unit) and unit(target_unit).si == "m" and position == "rad":
            hint = "; for a length give `wheel_diameter=...` as well, of the wheel that turns once with the encoder"
        raise UsageError(
            f"`unit={target_unit}`: the result's position is in {position}: {error}{hint}"
        ) from None


def _by_wheel(position: str, target_unit: str, diameter: float) -> float:
    """The same for a wheel of that diameter [m], on whose rim the wanted unit is: half of it a radian."""
    if position != "rad":
        raise UnitError("a wheel's diameter belongs to an angle; leave `wheel_diameter=...` out")
    if unit(target_unit).si != "m":
        raise UnitError("a wheel's diameter gives a length: choose `unit=m`, ft or inch")
    return convert(0.5 * diameter, "m", target_unit)

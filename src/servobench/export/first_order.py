"""The first-order motor in an answer."""

from __future__ import annotations

import numpy as np

from servobench.core.errors import UnitError, UsageError
from servobench.core.units import convert, unit
from servobench.export.summary import ResultSummary
from servobench.systems.first_order import FirstOrderMotor, scale_estimate


def first_order_motor(
    answer: ResultSummary, target: str, position_unit: str | None = None
) -> FirstOrderMotor:
    """Return the motor in an answer; `target` is what messages call the form that asks for it.

    Raises `UsageError` where the answer is of another structure or its input no voltage, or the unit doesn't fit.
    """
    told = answer.estimates
    if not {"gain", "time_constant"} <= told.keys() or len(answer.transfer_function.denominator) > 2:
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
    wanted = position_unit or position
    factor = _factor(position, wanted)
    rows = [list(told).index(name) for name in ("gain", "time_constant")]
    moments = np.zeros((3, 3))
    known = [*rows, list(told).index("delay")] if "delay" in told else rows
    moments[: len(known), : len(known)] = answer.covariance[np.ix_(known, known)]
    scale = np.array([factor, 1.0, 1.0])
    return FirstOrderMotor(
        unit=wanted,
        gain=scale_estimate(told["gain"], factor, f"{wanted}/(s·V)"),
        time_constant=told["time_constant"],
        delay=max(answer.transfer_function.delay, 0.0),
        coulomb_voltage=told.get("coulomb_voltage"),
        offset_voltage=told.get("offset_voltage"),
        one_way="one_way" in answer.structure,
        moments=moments * np.outer(scale, scale),
        doubtful=answer.verdict == "doubtful",
    )


def comment_for(motor: FirstOrderMotor, answer: ResultSummary) -> tuple[str, ...]:
    """Return what a file with gains for this motor should say: they allow for its delay as estimated, below zero for none."""
    return answer.comment if motor.delay else answer.model_comment


def _factor(position: str, wanted: str) -> float:
    """How many of the wanted unit one of the answer's unit of position is."""
    if position == wanted:
        return 1.0
    try:
        if unit(wanted).quantity != "position":
            raise UnitError(f"{wanted} isn't a unit of position")
        return convert(1.0, position, wanted)
    except UnitError as error:
        raise UsageError(f"`unit={wanted}`: the result's position is in {position}: {error}") from None

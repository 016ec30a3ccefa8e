"""WPILib: feedforward constants kS, kV, kA, kG in the user's units, and feedback gains with the delay in mind."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, ClassVar

from servobench.core.errors import UsageError
from servobench.core.estimate import Estimate
from servobench.core.json_numbers import finite
from servobench.export.base import TARGETS, Wishes
from servobench.export.first_order import comment_for, first_order_motor
from servobench.export.summary import ResultSummary
from servobench.export.tuning import Tuning, tune_loops
from servobench.systems.first_order import FirstOrderMotor, inverse, ratio

_PERIOD = 0.02  # s, of a WPILib robot's loop


@TARGETS.member("wpilib")
class Wpilib:
    """A JSON file with kS, kV, kA (and kG, where a constant load is known) with their intervals, and gains for both loops.

    u = kS sgn(v) + kG + kV v + kA dv/dt, with kV = 1/K and kA = τ/K,
    which follows from the first-order motor solved for its input.
    """

    suffix: ClassVar[str] = ".json"
    wishes: ClassVar[frozenset[str]] = frozenset({"unit", "sample_time", "closed_loop"})

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file; raises `UsageError` for a motor that isn't of first order, or not driven by a voltage."""
        motor = first_order_motor(answer, "wpilib", wishes.unit)
        if motor.gain.value < 0:
            raise UsageError(
                "wpilib: a positive voltage turns this motor in the negative direction; invert the motor or the encoder, then "
                "identify again (WPILib's constants are positive)"
            )
        gains = tune_loops(motor, wishes.sample_time or _PERIOD, wishes.closed_loop)
        document = {
            "from": list(comment_for(motor, answer)),
            "unit": motor.unit,
            "feedforward": {name: _plain(e) for name, e in feedforward(motor).items()},
            "notes": _notes(motor),
            "feedback": _feedback(gains, motor.unit, wishes.sample_time or _PERIOD),
        }
        text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
        return {f"{stem}.json": f"{text}\n".encode()}


def feedforward(motor: FirstOrderMotor) -> dict[str, Estimate]:
    """Return kS [V], kV [V·s/unit], kA [V·s²/unit] and, where an offset is known, kG [V], each with its interval."""
    constants = {
        "kV": inverse(motor.gain, f"V·s/{motor.unit}"),
        "kA": ratio(motor.time_constant, motor.gain, float(motor.moments[0, 1]), f"V·s²/{motor.unit}"),
    }
    if motor.coulomb_voltage is not None:
        constants = {"kS": motor.coulomb_voltage, **constants}
    offset = motor.offset_voltage
    if offset is not None and not offset.interval[0] <= 0 <= offset.interval[1]:
        constants["kG"] = offset
    return constants


def _notes(motor: FirstOrderMotor) -> list[str]:
    notes = []
    if motor.coulomb_voltage is None:
        notes.append("kS is left out: the model has no friction.")
    if motor.one_way:
        notes.append(
            "The motor turned one way only, so kS holds friction and any constant load (kG) together; let it turn both ways."
        )
    if motor.offset_voltage is not None:
        notes.append(
            "kG is the offset voltage, a constant load (an elevator's weight) if nothing else shifts the input; it "
            "is left out if it isn't significantly different from zero. An arm's kG is multiplied by the cosine of "
            "its angle."
        )
    return notes


def _feedback(gains: Tuning, unit: str, period: float) -> dict[str, Any]:
    return {
        "period": {"value": period, "unit": "s"},
        "dead_time": {"value": gains.dead_time, "unit": "s"},
        "closed_loop": {"value": gains.closed_loop, "unit": "s"},
        "velocity": {
            "kP": {"value": gains.speed_gain, "unit": f"V·s/{unit}"},
            "kI": {"value": gains.speed_integral, "unit": f"V/{unit}"},
        },
        "position": {
            "kP": {"value": gains.position_gain, "unit": f"V/{unit}"},
            "kD": {"value": gains.position_derivative, "unit": f"V·s/{unit}"},
        },
        "phase_margin": _margin(gains.phase_margin, 180 / math.pi, "deg"),
        "delay_margin": _margin(gains.delay_margin, 1.0, "s"),
    }


def _margin(values: tuple[float, float, float], factor: float, unit: str) -> dict[str, Any]:
    value, low, high = (finite(factor * x) for x in values)
    return {"value": value, "interval": [low, high], "level": 0.95, "unit": unit}


def _plain(e: Estimate) -> dict[str, Any]:
    return {
        "value": e.value,
        "sd": finite(e.sd),
        "interval": [finite(end) for end in e.interval],
        "level": e.level,
        "unit": e.unit,
    }

"""WPILib: feedforward constants kS, kV, kA, kG in the user's units, and feedback gains with the delay in mind."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any, ClassVar

from servobench.core.estimate import Estimate
from servobench.core.json_numbers import finite
from servobench.export.base import TARGETS, Wishes
from servobench.export.robot import WISHES, RobotConstants, robot_constants
from servobench.export.summary import ResultSummary


@TARGETS.member("wpilib")
class Wpilib:
    """A JSON file with kS, kV, kA (and kG or kCos, where a load is known) with their intervals, and gains for both loops."""

    suffix: ClassVar[str] = ".json"
    wishes: ClassVar[frozenset[str]] = WISHES

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the one file; raises `UsageError` for a motor that isn't of first order, or not driven by a voltage."""
        constants = robot_constants(answer, "wpilib", wishes)
        document = {
            "from": list(constants.comment),
            "unit": constants.unit,
            "feedforward": {name: _plain(e) for name, e in constants.feedforward.items()},
            "level_angle": constants.level_angle,
            "notes": list(constants.notes),
            "feedback": _feedback(constants),
        }
        text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False)
        return {f"{stem}.json": f"{text}\n".encode()}


def _feedback(constants: RobotConstants) -> dict[str, Any]:
    gains, unit = constants.gains, constants.unit
    return {
        "period": {"value": constants.period, "unit": "s"},
        "measurement_delay": {"value": constants.measurement_delay, "unit": "s"},
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

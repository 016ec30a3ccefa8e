"""The loop that theory is computed with: the motor as K/(τs + 1), and a feedback law in front of it as it is written."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import model_validator

from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.identification.models.base import Output
from servobench.lab.expression import Expression
from servobench.lab.studies.base import Stand, StudySettings
from servobench.systems.control.base import Controller
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.transfer_function import TransferFunction
from servobench.systems.tuning.base import Tunable


class OfAMotor(StudySettings):
    """The settings of studies that compute with K/(τs + 1): where its two numbers come from."""

    gain: str = "sheet_gain"
    """The motor's gain K, an expression over facts [rad/(s·V)]."""
    time_constant: str = "sheet_time_constant"
    """Its time constant τ, an expression over facts [s]."""

    @model_validator(mode="after")
    def _can_be_computed(self) -> Self:
        Expression(self.gain)
        Expression(self.time_constant)
        return self

    def motor(self, stand: Stand) -> tuple[float, float]:
        """Return K and τ [s]; raises `UnknownName` for a fact that isn't there, `UsageError` for a τ that isn't above 0."""
        gain, tau = (Expression(text).evaluate(stand.facts).value for text in (self.gain, self.time_constant))
        if not tau > 0:
            raise UsageError(f"the time constant `{self.time_constant}` is {tau:g} s; expected more than 0")
        return gain, tau


def motor_system(gain: float, tau: float, output: Output) -> TransferFunction:
    """Return K/(τs + 1) to the speed, K/(s (τs + 1)) to the position, for K [rad/(s·V)] and τ [s]."""
    if output == "speed":
        return TransferFunction(numerator=(gain,), denominator=(tau, 1.0), output="speed", unit="rad/(s·V)")
    return TransferFunction(numerator=(gain,), denominator=(tau, 1.0, 0.0), output="position", unit="rad/V")


def on_paper(law: Tunable, gain: float, tau: float) -> TransferFunction:
    """Return the open loop of a law as it is written: continuous, with a derivative without filter, without hold and delay.

    The motor has the gain K [rad/(s·V)] and the time constant τ [s].
    """
    below: tuple[float, ...] = (tau, 1.0) if law.output == "speed" else (tau, 1.0, 0.0)
    if isinstance(law, Lead):
        above: tuple[float, ...] = (law.gain / law.zero, law.gain)
        below = tuple(map(float, np.convolve(below, (1 / law.pole, 1.0))))
    else:
        if isinstance(law, Pid):
            powers = (law.kd, law.kp, law.ki)
        elif law.output == "position":
            powers = (law.speed_gain, law.position_gain, law.integral_gain)
        else:
            powers = (0.0, law.speed_gain, law.integral_gain)
        above = powers if powers[2] else powers[:2]
        below = (*below, 0.0) if len(above) == 3 else below
    return TransferFunction(
        numerator=tuple(gain * c for c in above), denominator=below, output=law.output, unit="1"
    )


def tunable(controller: Controller) -> Tunable:
    """Return a controller that a loop can be computed of; raises `UsageError` for another."""
    if isinstance(controller, Pid | Lead | StateFeedback):
        return controller
    raise UsageError(
        f"{type(controller).__name__} isn't a supported feedback law; expected pid, lead or state_feedback"
    )


def gains_text(controller: Controller) -> str:
    """Return what a law is called in a table: its gains."""
    if isinstance(controller, Pid):
        parts = (("kp", controller.kp), ("ki", controller.ki), ("kd", controller.kd))
        return ", ".join(f"{name} {plain(value)}" for name, value in parts if value)
    if isinstance(controller, Lead):
        return f"lead, gain {plain(controller.gain)}, zero {plain(controller.zero)}, pole {plain(controller.pole)}"
    return type(controller).__name__

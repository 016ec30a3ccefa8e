"""The torque constant: magnets are stronger or weaker than the sheet says, and weaker when warm."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log

from servobench.core.channels import Array
from servobench.core.rounding import plain
from servobench.identification.reconciliation.base import (
    CAUSES,
    Decision,
    Excluded,
    Question,
    Sizes,
    normal,
    share_of,
)

_SD = 0.06  # of ln k: ±12 % on a maker's no-load speed (QUBE-Servo 3 manual) as two standard deviations


@dataclass(frozen=True)
class TorqueConstant:
    """κ k in place of k: K is about 1/k and τ about R J/k², so the time constant moves twice as far."""

    label: str = "torque constant"
    law: str = "A smaller torque constant raises the gain, and the time constant by twice as much."
    occurrence: float = 0.1
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """ln κ: normal, 6 %."""
        return normal(_SD)

    def domain(self, question: Question) -> tuple[float, float]:
        """ln of the factor: a quarter to four times."""
        return (-1.5, 1.5)

    def effect(self, question: Question, size: float) -> Array:
        """With x = R b/k²: K by κ (1 + x)/(κ² + x), τ by (1 + x)/(κ² + x).

        It follows from K = k/(R b + k²) and τ = R J/(R b + k²).
        """
        x = question.friction or 0.0
        tau = log((1 + x) / (exp(2 * size) + x))
        return question.shift(gain=size + tau, time_constant=tau)

    def size_text(self, question: Question, size: float) -> str:
        """In V·s/rad where the sheet is known."""
        if question.motor is None:
            return f"{share_of(exp(size))} torque constant"
        return f"{self.amount(question, size)} instead of {self.amount(question, 0.0)}"

    def amount(self, question: Question, size: float) -> str:
        """In V·s/rad, or as a part."""
        if question.motor is None:
            return share_of(exp(size))
        return f"{plain(question.motor.motor_constant * exp(size), 3)} V·s/rad"

    def decision_for(self, question: Question, size: float) -> Decision:
        """Turn the shaft from outside: the open terminals show k ω."""
        sentence = (
            "Turn the shaft from outside at a known speed and measure the voltage at the open terminals: it is k times the "
            "speed"
        )
        if question.motor is not None:
            k = question.motor.motor_constant
            other = plain(100 * k * exp(size), 3)
            sentence += (
                f", at 100 rad/s {plain(100 * k, 3)} V with the nominal k and {other} V with the other"
            )
        return Decision(sentence=f"{sentence}.")


CAUSES.member("torque_constant")(TorqueConstant())

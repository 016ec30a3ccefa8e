"""Series resistance: a winding, a cable or an amplifier with more resistance than on the data sheet, or a warm winding."""

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
from servobench.rig.experiment.experiment import Experiment
from servobench.systems.signals.constant import Constant

_SD = 0.12  # of ln R: a maker's ±12 % (QUBE-Servo 3 manual), cable and amplifier, and copper's 0.39 % for each K
_LEVEL = 2.0  # V on a locked shaft: enough to be read, too little to warm the winding in 2 s


@dataclass(frozen=True)
class SeriesResistance:
    """R (1 + r) in place of R: τ = R J/(R b + k²) grows with it, and K = k/(R b + k²) only falls where b isn't zero.

    Source: see `models.first_order`.
    """

    label: str = "series resistance"
    law: str = (
        "More resistance lengthens the time constant and, without viscous friction, doesn't change the gain."
    )
    occurrence: float = 0.1
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """ln of the factor on R: normal, 12 %."""
        return normal(_SD)

    def domain(self, question: Question) -> tuple[float, float]:
        """ln of the factor: a twelfth to twelve times."""
        return (-2.5, 2.5)

    def effect(self, question: Question, size: float) -> Array:
        """With x = R b/k²: K falls by (1 + x)/(1 + x e^s), and τ grows by e^s times that."""
        x = question.friction or 0.0
        damping = log((1 + x) / (1 + x * exp(size)))
        return question.shift(gain=damping, time_constant=size + damping)

    def size_text(self, question: Question, size: float) -> str:
        """In ohms where the sheet is known."""
        if question.motor is None:
            return f"{share_of(exp(size))} resistance"
        return f"{self.amount(question, size)} instead of {self.amount(question, 0.0)}"

    def amount(self, question: Question, size: float) -> str:
        """In ohms, or as a part."""
        if question.motor is None:
            return share_of(exp(size))
        return f"{plain(question.motor.resistance * exp(size), 3)} Ω"

    def decision_for(self, question: Question, size: float) -> Decision:
        """Hold the shaft: the current is u/R."""
        amount = "measure the current: the resistance is u/i"
        if question.motor is not None:
            r = question.motor.resistance
            amount += (
                f", and {plain(_LEVEL, 2)} V drive {plain(_LEVEL / r, 3)} A through {plain(r, 3)} Ω, "
                f"{plain(_LEVEL / (r * exp(size)), 3)} A through {plain(r * exp(size), 3)} Ω"
            )
        return Decision(
            sentence=f"Hold the shaft, apply {plain(_LEVEL, 2)} V for 2 s and {amount}.",
            experiment=Experiment(
                name="locked shaft", signal=Constant(value=_LEVEL), duration=2.0, sample_time=0.002
            ),
        )


CAUSES.member("series_resistance")(SeriesResistance())

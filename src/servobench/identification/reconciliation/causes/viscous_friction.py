"""Viscous friction: drag in proportion to the speed, which a data sheet rarely gives."""

from __future__ import annotations

from dataclasses import dataclass
from math import log1p

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import plain, with_unit
from servobench.identification.reconciliation.base import CAUSES, Decision, Excluded, Question, Sizes, normal
from servobench.rig.experiment.experiment import Experiment
from servobench.systems.signals.pulse import Pulse

_SD = 0.1  # of R b/k²: bearings and brushes of small motors take a few per cent of the speed, rarely more than a fifth
_LOST = 0.05  # of R b/k²: what a motor of unknown friction may have to lose


@dataclass(frozen=True)
class ViscousFriction:
    """ξ = R Δb/k² more of it: K and τ both fall by the factor 1 + ξ/(1 + x), x being what there was.

    It follows from K = k/(R b + k²) and τ = R J/(R b + k²).
    """

    label: str = "viscous friction"
    law: str = "Viscous friction lowers gain and time constant together, by the same factor."
    occurrence: float = 0.15
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """Half normal, 0.1; there can be less of it, too, but no less than none."""
        more = normal(_SD, side="positive")
        there_is = question.friction
        if question.origin == "data sheet" and not there_is:
            return more
        if there_is is None:
            less = np.linspace(-4 * _LOST, 0.0, 41)[:-1]
            weights = np.exp(-0.5 * (less / _LOST) ** 2)
            return _either(less, weights / weights.sum(), more)
        # What there is may be all gone, or any part of it.
        less = np.linspace(-there_is, 0.0, 41)[:-1]
        return _either(less, np.full(len(less), 1 / len(less)), more)

    def domain(self, question: Question) -> tuple[float, float]:
        """No less than none of it."""
        less = 0.5 if question.friction is None else question.friction
        return (-less, 20.0)

    def effect(self, question: Question, size: float) -> Array:
        """-ln(1 + ξ/(1 + x)) on both."""
        x = question.friction or 0.0
        low = -log1p(max(size / (1 + x), -0.99))
        return question.shift(gain=low, time_constant=low)

    def size_text(self, question: Question, size: float) -> str:
        """The change, in N·m·s/rad if the data sheet is known."""
        what = "R b/k²" if question.motor is None else "b"
        return f"{what} {'higher' if size >= 0 else 'lower'} by {self.amount(question, size)}"

    def amount(self, question: Question, size: float) -> str:
        """In N·m·s/rad, or as R b/k²."""
        if question.motor is None:
            return plain(abs(size), 2)
        scale = question.motor.motor_constant**2 / question.motor.resistance
        return with_unit(abs(size) * scale, "N·m·s/rad", 2)

    def decision_for(self, question: Question, size: float) -> Decision:
        """Switch the winding off and let it coast."""
        sentence = (
            "Bring the motor to speed, open the winding (no current) and let it coast: with viscous friction alone "
            "the speed falls as e^(-t b/J), Coulomb friction along a straight line"
        )
        # Held for long enough to be at speed; the coasting is examined with the winding open.
        return Decision(
            sentence=f"{sentence}.",
            experiment=Experiment(
                name="coast down", signal=Pulse(level=3.0, start=0.0, width=2.0), duration=6.0
            ),
        )


def _either(less: Array, weights: Array, more: Sizes) -> Sizes:
    """Less of it or more, as probably."""
    return Sizes(
        values=np.append(less, more.values),
        weights=0.5 * np.append(weights, more.weights),
        steps=np.append(np.full(len(less), float(less[1] - less[0])), more.steps),
    )


CAUSES.member("viscous_friction")(ViscousFriction())

"""Inertia: more or less than assumed, or a part that was left out of the sum."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import with_unit
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
from servobench.systems.signals.square import Square

_SD = 0.12  # of ln J: masses and radii to a few per cent, hubs and screws left out
_LEFT_OUT = 0.3  # of all wrong inertias: a part was forgotten
_CALCULATED = 0.01  # of a time constant that is calculated from rounded values, winding and friction left out
_PARTS = ("rotor", "hub", "disc")


@dataclass(frozen=True)
class Inertia:
    """J (1 + j) in place of J: τ is proportional to it, K doesn't know of it."""

    label: str = "inertia"
    law: str = "The time constant is proportional to the inertia; the gain doesn't depend on it."
    occurrence: float = 0.1
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """ln of the factor on J: normal, 12 %, or one of the parts of the sheet forgotten."""
        spread = normal(_SD)
        forgotten = [log(left) for _, left in _without(question)]
        if not forgotten:
            return spread
        n = len(forgotten)
        return Sizes(
            values=np.append(spread.values, forgotten),
            weights=np.append((1 - _LEFT_OUT) * spread.weights, np.full(n, _LEFT_OUT / n)),
            steps=np.append(spread.steps, np.zeros(n)),
            scatter={"time_constant": np.append(np.zeros(len(spread.values)), np.full(n, _CALCULATED))},
        )

    def domain(self, question: Question) -> tuple[float, float]:
        """ln of the factor: a twelfth to twelve times."""
        return (-2.5, 2.5)

    def effect(self, question: Question, size: float) -> Array:
        """τ grows by e^s."""
        return question.shift(time_constant=size)

    def size_text(self, question: Question, size: float) -> str:
        """In kg·m² where the sheet is known, and the part that is about as large as what is missing."""
        if question.motor is None:
            return f"{share_of(exp(size))} inertia"
        text = f"{self.amount(question, size)} instead of {self.amount(question, 0.0)}"
        near = [part for part, left in _without(question) if abs(log(left) - size) < 0.05]
        return f"{text}, as without the {near[0]}" if near else text

    def amount(self, question: Question, size: float) -> str:
        """In kg·m², or as a part."""
        if question.motor is None:
            return share_of(exp(size))
        return with_unit(question.motor.inertia * exp(size), "kg·m²", 3)

    def decision_for(self, question: Question, size: float) -> Decision:
        """Add a known inertia: τ grows by R/k² times it, whatever the inertia before."""
        sentence = "Add a disc of known inertia and repeat the run: the time constant grows by R/k² for each kg·m² added"
        if question.motor is not None:
            r, k, j = question.motor.resistance, question.motor.motor_constant, question.motor.inertia
            sentence += f"; {with_unit(j, 'kg·m²', 3)} more add {with_unit(r * j / k**2, 's', 3)} if R and k are right"
        return Decision(sentence=f"{sentence}.", experiment=_square(question))


def _without(question: Question) -> list[tuple[str, float]]:
    """The parts that could be left out, and what is then left of the inertia."""
    if question.motor is None:
        return []
    j = question.motor.inertia
    parts = [(part, 1 - getattr(question.motor, f"{part}_inertia") / j) for part in _PARTS]
    return [(part, left) for part, left in parts if 0.02 < left < 0.98]


def _square(question: Question) -> Experiment:
    """A square wave that holds each level for five time constants."""
    held = 5 * max(question.before.get("time_constant", 0.1), question.after.get("time_constant", 0.0))
    return Experiment(
        name="known disc", signal=Square(low=1.0, high=3.0, frequency=float(f"{0.5 / held:.1g}"))
    )


CAUSES.member("inertia")(Inertia())

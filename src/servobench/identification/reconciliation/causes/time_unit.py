"""The unit of time: milliseconds or minutes taken for seconds."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log

import numpy as np

from servobench.core.channels import Array
from servobench.identification.reconciliation.base import CAUSES, Decision, Excluded, Question, Sizes

_FACTORS = {"1000": (1000.0, 0.9), "60": (60.0, 0.1)}


@dataclass(frozen=True)
class TimeUnit:
    """A factor on the claimed time alone: τ is wrong by it, K isn't."""

    label: str = "unit of time"
    law: str = "Milliseconds or minutes read as seconds, or the reverse, change a time constant by a factor of 1000 or 60."
    occurrence: float = 0.02
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """ln of the factors, for a figure that somebody wrote down."""
        if "time_constant" not in question.names:
            return Excluded("it doesn't change the gain")
        if question.origin != "claim":
            return Excluded("a data sheet's time constant is computed here from its other values")
        values = [sign * log(factor) for factor, _ in _FACTORS.values() for sign in (1, -1)]
        weights = [0.5 * weight for _, weight in _FACTORS.values() for _ in (1, -1)]
        return Sizes(values=np.array(values), weights=np.array(weights), steps=np.zeros(len(values)))

    def domain(self, question: Question) -> tuple[float, float]:
        """A thousand, either way."""
        return (-log(1000.0), log(1000.0))

    def effect(self, question: Question, size: float) -> Array:
        """τ grows by e^s."""
        return question.shift(time_constant=size)

    def size_text(self, question: Question, size: float) -> str:
        """What was taken for what."""
        return f"the time {exp(abs(size)):.0f} times too {'long' if size > 0 else 'short'}"

    def amount(self, question: Question, size: float) -> str:
        """The same."""
        return self.size_text(question, size)

    def decision_for(self, question: Question, size: float) -> Decision:
        """Look at the figure's unit."""
        return Decision(
            sentence="Check the source of the figure: is it in s, ms or min? Give its unit, such as tau=130ms."
        )


CAUSES.member("time_unit")(TimeUnit())

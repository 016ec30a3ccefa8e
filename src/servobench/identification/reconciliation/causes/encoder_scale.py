"""The encoder's scale: counts in a turn, or a unit, mistaken by one of the usual factors."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log, pi

import numpy as np

from servobench.core.channels import Array
from servobench.identification.reconciliation.base import CAUSES, Decision, Excluded, Question, Sizes

# Lines taken for counts of a quadrature decoder, single edges for both; then degrees, rad and turns taken for one another, and
# minutes for seconds.
_FACTORS = {
    "2": (2.0, 0.2),
    "4": (4.0, 0.3),
    "2π": (2 * pi, 0.08),
    "180/π": (180 / pi, 0.08),
    "360": (360.0, 0.02),
    "60": (60.0, 0.04),
    "60/2π": (60 / (2 * pi), 0.03),
    "6": (6.0, 0.02),
}
_TWICE = 0.5 / sum(weight for _, weight in _FACTORS.values())  # each factor, and one over it


@dataclass(frozen=True)
class EncoderScale:
    """A factor on every position and speed: K is wrong by it, τ isn't."""

    label: str = "encoder scale"
    law: str = "A wrong scale multiplies or divides the gain by 2, 4, 2π, 180/π or 60, and doesn't change the time constant."
    occurrence: float = 0.05
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """ln of the usual factors."""
        if "gain" not in question.names:
            return Excluded("it doesn't change the time constant")
        values = [sign * log(factor) for factor, _ in _FACTORS.values() for sign in (1, -1)]
        weights = [_TWICE * weight for _, weight in _FACTORS.values() for _ in (1, -1)]
        return Sizes(values=np.array(values), weights=np.array(weights), steps=np.zeros(len(values)))

    def domain(self, question: Question) -> tuple[float, float]:
        """The largest of the factors, either way."""
        return (-log(360.0), log(360.0))

    def effect(self, question: Question, size: float) -> Array:
        """K grows by e^s."""
        return question.shift(gain=size)

    def size_text(self, question: Question, size: float) -> str:
        """The factor on all speeds."""
        for text, (factor, _) in _FACTORS.items():
            if abs(abs(size) - log(factor)) < 1e-9:
                return (
                    f"all speeds {text if size > 0 else f'1/({text})' if '/' in text else f'1/{text}'} times"
                )
        return f"all speeds {exp(size):.3g} times"

    def amount(self, question: Question, size: float) -> str:
        """The same."""
        return self.size_text(question, size)

    def decision_for(self, question: Question, size: float) -> Decision:
        """Turn the shaft by hand."""
        return Decision(
            sentence="Turn the shaft by hand through exactly one turn: the position must change by 2π rad, or by "
            "the counts per turn (four for each line of the encoder's disc). Compare the units of both figures: rad, degrees or "
            "turns, a second or a minute."
        )


CAUSES.member("encoder_scale")(EncoderScale())

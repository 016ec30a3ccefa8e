"""The encoder's scale: counts in a turn, or a unit, mistaken by one of the usual factors."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, log, pi

import numpy as np

from servobench.core.channels import Array
from servobench.identification.reconciliation.base import CAUSES, Decision, Excluded, Question, Sizes

# Lines taken for counts of a quadrature decoder, single edges for both; then rad for turns, minutes for seconds.
_FACTORS = {2.0: 0.2, 4.0: 0.3, 2 * pi: 0.08, 60.0: 0.04, 60 / (2 * pi): 0.03}
_TWICE = 0.5 / sum(_FACTORS.values())  # each factor, and one over it


@dataclass(frozen=True)
class EncoderScale:
    """A factor on every position and speed: K is wrong by it, τ isn't."""

    label: str = "encoder scale"
    law: str = "A wrong scale multiplies or divides the gain by 2, 4, 2π or 60, and doesn't change the time constant."
    occurrence: float = 0.05
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """ln of the usual factors."""
        if "gain" not in question.names:
            return Excluded("it doesn't change the time constant")
        values = [sign * log(factor) for factor in _FACTORS for sign in (1, -1)]
        weights = [_TWICE * weight for weight in _FACTORS.values() for _ in (1, -1)]
        return Sizes(values=np.array(values), weights=np.array(weights), steps=np.zeros(len(values)))

    def domain(self, question: Question) -> tuple[float, float]:
        """From a sixtieth to sixty."""
        return (-log(60.0), log(60.0))

    def effect(self, question: Question, size: float) -> Array:
        """K grows by e^s."""
        return question.shift(gain=size)

    def size_text(self, question: Question, size: float) -> str:
        """The factor on all speeds."""
        for factor, text in ((2.0, "2"), (4.0, "4"), (2 * pi, "2π"), (60.0, "60"), (60 / (2 * pi), "60/2π")):
            if abs(abs(size) - log(factor)) < 1e-9:
                return f"all speeds {text if size > 0 else f'1/{text}'} times"
        return f"all speeds {exp(size):.3g} times"

    def amount(self, question: Question, size: float) -> str:
        """The same."""
        return self.size_text(question, size)

    def decision_for(self, question: Question, size: float) -> Decision:
        """Turn the shaft by hand."""
        return Decision(
            sentence="Turn the shaft by hand through exactly one turn: the position must change by 2π rad, or by "
            "the counts per turn (four for each line of the encoder's disc)."
        )


CAUSES.member("encoder_scale")(EncoderScale())

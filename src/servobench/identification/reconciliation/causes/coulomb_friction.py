"""Coulomb friction, if the claim's calculation leaves it out."""

from __future__ import annotations

from dataclasses import dataclass
from math import log1p

import numpy as np

from servobench.core.channels import Array
from servobench.identification.reconciliation.base import CAUSES, Decision, Excluded, Question, Sizes
from servobench.identification.reconciliation.levels import loss_shares, reverses
from servobench.rig.experiment.experiment import Experiment
from servobench.systems.signals.staircase import Staircase


@dataclass(frozen=True)
class CoulombFriction:
    """c = u_c/u of the input is lost: a gain ω/u reads K (1 - c), and 63.2 % of a reversal is passed at τ (1 - ln(1 + c)).

    While the shaft slows down friction helps, so it heads for -K u (1 + c); once it has turned round, for -K u (1 - c).
    Both follow from that. Between two speeds in one direction friction is a constant and τ reads as it is.
    """

    label: str = "Coulomb friction"
    law: str = "Neglected Coulomb friction lowers the gain, and the time constant at reversals."
    occurrence: float = 0.1
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """Known from the fit, but for the level at which the gain was read."""
        if question.origin == "data sheet":
            return Excluded("the fit measures the friction and allows for it, so it affects neither figure")
        shares = loss_shares(question)
        if shares is None:
            return Excluded("the data show no friction")
        if "gain" not in question.names and not reverses(question):
            return Excluded("between two speeds in one direction it doesn't change the time constant")
        return Sizes(values=shares, weights=np.full(len(shares), 1 / len(shares)), steps=np.gradient(shares))

    def domain(self, question: Question) -> tuple[float, float]:
        """From nothing to nearly the whole input."""
        return (0.0, 0.95)

    def effect(self, question: Question, size: float) -> Array:
        """ln(1 - c) on K; ln(1 - ln(1 + c)) on τ where the motor reverses."""
        tau = log1p(-log1p(min(size, 0.95))) if reverses(question) else 0.0
        return question.shift(gain=log1p(-min(size, 0.95)), time_constant=tau)

    def size_text(self, question: Question, size: float) -> str:
        """The part of the input."""
        return f"{100 * size:.2g} % of the input"

    def amount(self, question: Question, size: float) -> str:
        """The same."""
        return self.size_text(question, size)

    def decision_for(self, question: Question, size: float) -> Decision:
        """Several levels: the line through steady speeds doesn't pass zero."""
        return Decision(
            sentence="Hold several levels and plot the steady speed over the input: the slope is the gain, and the "
            "line crosses zero speed at the Coulomb voltage.",
            experiment=Experiment(
                name="levels", signal=Staircase(levels=(1.0, 2.0, 3.0, 4.0), dwell=2.0), duration=8.0
            ),
        )


CAUSES.member("coulomb_friction")(CoulombFriction())

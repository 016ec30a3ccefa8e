"""The amplifier's dead band, if the claim's calculation uses the commanded voltage."""

from __future__ import annotations

from dataclasses import dataclass
from math import log1p

import numpy as np

from servobench.core.channels import Array
from servobench.identification.reconciliation.base import CAUSES, Decision, Excluded, Question, Sizes
from servobench.identification.reconciliation.levels import loss_shares
from servobench.rig.experiment.experiment import Experiment
from servobench.systems.signals.ramp import Ramp


@dataclass(frozen=True)
class DeadBand:
    """v of the commanded input isn't put out: a gain ω/u reads K (1 - v/u). τ reads as it is, as a step stays a step.

    The fit finds dead band and friction as one lost input and can't separate them, so any part may be the dead band's.
    """

    label: str = "dead band"
    law: str = (
        "A dead band of the amplifier lowers a gain read at one level, and doesn't change the time constant."
    )
    occurrence: float = 0.05
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """Up to what is lost at the lowest level."""
        if question.origin == "data sheet":
            return Excluded("the fit measures the lost input and allows for it, so it affects neither figure")
        if "gain" not in question.names:
            return Excluded("it doesn't change the time constant")
        shares = loss_shares(question)
        if shares is None:
            return Excluded("the data show no lost input")
        values = np.linspace(0.0, float(shares.max()), 41)
        return Sizes(
            values=values, weights=np.full(41, 1 / 41), steps=np.full(41, float(values[1] - values[0]))
        )

    def domain(self, question: Question) -> tuple[float, float]:
        """From nothing to nearly the whole input."""
        return (0.0, 0.95)

    def effect(self, question: Question, size: float) -> Array:
        """ln(1 - v/u) on K."""
        return question.shift(gain=log1p(-min(size, 0.95)))

    def size_text(self, question: Question, size: float) -> str:
        """The part of the input."""
        return f"{100 * size:.2g} % of the input"

    def amount(self, question: Question, size: float) -> str:
        """The same."""
        return self.size_text(question, size)

    def decision_for(self, question: Question, size: float) -> Decision:
        """Measure the voltage at the motor while the command rises slowly."""
        return Decision(
            sentence="Raise the command slowly from zero and measure the voltage at the motor's terminals: behind a dead band it "
            "stays at zero at first, with friction alone it doesn't.",
            experiment=Experiment(name="slow ramp", signal=Ramp(final=2.0, duration=10.0), duration=10.0),
        )


CAUSES.member("dead_band")(DeadBand())

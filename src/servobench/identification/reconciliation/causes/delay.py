"""Delay: a stopwatch that was started at the command, before anything acted."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, log1p

from servobench.core.channels import Array
from servobench.core.rounding import with_unit
from servobench.identification.reconciliation.base import (
    CAUSES,
    Decision,
    Excluded,
    Question,
    Sizes,
    normal,
    single,
)
from servobench.rig.experiment.experiment import Experiment
from servobench.systems.signals.step import Step

_SD = 0.01  # s, of an unmeasured delay: a USB transfer or a few ticks of a host


@dataclass(frozen=True)
class Delay:
    """A time to 63.2 % from the command on is d longer: τ + d. Nothing else moves."""

    label: str = "delay"
    law: str = "A delay lengthens a time measured from the command, and doesn't change gain or time constant."
    occurrence: float = 0.05
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """The delay that the fit has; for a data sheet one of some 10 ms where the fit doesn't tell it from a lag."""
        if question.origin == "data sheet":
            if "delay" in question.names:
                return normal(_SD, side="positive")
            return Excluded("the fit measures the delay separately from the time constant")
        if "time_constant" not in question.names:
            return Excluded("it doesn't change the gain")
        estimates = question.fit.estimates
        if "delay" not in estimates or not isfinite(estimates["delay"].sd):
            return normal(_SD, side="positive")
        delay = estimates["delay"].value
        if delay <= 0:
            return Excluded("the data show none")
        return single(delay, time_constant=estimates["delay"].sd / question.before["time_constant"])

    def domain(self, question: Question) -> tuple[float, float]:
        """From none to ten time constants."""
        tau = question.before.get("time_constant", inf)
        return (0.0, 10 * tau if isfinite(tau) else 1.0)

    def effect(self, question: Question, size: float) -> Array:
        """ln(1 + d/τ) on a reading; a fit has it as its delay."""
        if question.origin == "data sheet":
            return question.shift(delay=size)
        return question.shift(time_constant=log1p(size / question.before["time_constant"]))

    def size_text(self, question: Question, size: float) -> str:
        """In seconds."""
        return with_unit(size, "s", 2)

    def amount(self, question: Question, size: float) -> str:
        """The same."""
        return self.size_text(question, size)

    def decision_for(self, question: Question, size: float) -> Decision:
        """A step, sampled fast: the speed stays at zero for the delay."""
        return Decision(
            sentence="Record a step at the highest sample rate, as position or counts: with a delay nothing moves "
            "at first, with a lag the speed rises at once, but slowly.",
            experiment=Experiment(name="fast step", signal=Step(), duration=2.0, sample_time=0.0005),
        )


CAUSES.member("delay")(Delay())

"""The method: another way to find the figures than a 63.2 % reading, each re-enacted on the very data."""

from __future__ import annotations

from dataclasses import dataclass
from math import log

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import with_unit
from servobench.identification.reconciliation.base import CAUSES, Decision, Excluded, Question, Sizes
from servobench.identification.reconciliation.causes.measurement_lag import BY_EYE
from servobench.identification.reconciliation.readings import Reading
from servobench.identification.reconciliation.reenactment import BY_HAND, SPOKEN


@dataclass(frozen=True)
class Method:
    """The readings of the other methods from the same data, each as probable as the next. A size is the number of a reading."""

    label: str = "method"
    law: str = "Other methods give other values from the same data."
    occurrence: float = 0.1
    not_with: tuple[str, ...] = ("measurement_lag", "delay", "coulomb_friction")

    def sizes(self, question: Question) -> Sizes | Excluded:
        """One for each method that could be re-enacted, but for the 63.2 % that the measurement's lag is about."""
        if question.origin == "data sheet":
            return Excluded("a data sheet doesn't use the data")
        if question.method in BY_HAND:
            return Excluded(f"the method was {question.method}; its contribution is the lag")
        others = _others(question)
        if not others:
            return Excluded("no other method can be applied to these data")
        n = len(others)
        return Sizes(
            values=np.arange(n, dtype=np.float64),
            weights=np.full(n, 1 / n),
            steps=np.zeros(n),
            scatter={"time_constant": np.array([BY_EYE if each.by_hand else 0.0 for each in others])},
        )

    def domain(self, question: Question) -> tuple[float, float]:
        """The readings there are."""
        return (0.0, float(max(len(_others(question)) - 1, 0)))

    def effect(self, question: Question, size: float) -> Array:
        """The reading over the figures of the data."""
        reading = _others(question)[round(size)]
        shifts = {
            name: log(getattr(reading, name) / question.before[name])
            for name in question.names
            if name in ("gain", "time_constant")
        }
        return question.shift(**shifts)

    def size_text(self, question: Question, size: float) -> str:
        """Its name in words."""
        reading = _others(question)[round(size)]
        # The values that the question is about.
        units = {"gain": question.fit["gain"].unit, "time_constant": "s"}
        figures = [with_unit(getattr(reading, name), units[name]) for name in question.names if name in units]
        return f"{SPOKEN[reading.method]}, which gives {' and '.join(figures)}"

    def amount(self, question: Question, size: float) -> str:
        """The same."""
        return self.size_text(question, size)

    def decision_for(self, question: Question, size: float) -> Decision:
        """Ask how it was done."""
        return Decision(
            sentence="Ask how the figure was found, or apply the same method to an unfiltered speed from raw "
            "counts: an effect of the method changes, one of the motor stays."
        )


def _others(question: Question) -> list[Reading]:
    """The readings that aren't a 63.2 % reading, and make a motor of the same sense."""
    return [
        each
        for each in question.readings
        if each.method != "step_63"
        and not each.why_not
        and each.time_constant > 0
        and ("gain" not in question.names or each.gain * question.before["gain"] > 0)
    ]


CAUSES.member("method")(Method())

"""The measurement's lag: a filter behind the differentiated encoder, counted as part of the motor."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, log1p

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import plain, with_unit
from servobench.identification.reconciliation.base import CAUSES, Decision, Excluded, Question, Sizes, single
from servobench.identification.reconciliation.reenactment import BY_HAND

BY_EYE = 0.03  # of a time constant: a cursor or a ruler on a curve, a few milliseconds of a tenth of a second
_CLAIMED = (
    50.0,
    log(2.0),
)  # rad/s and sd of its ln: the cut-off that the paper's toolkit comes with, and its neighbours
_RECORDED = (100.0, 0.9)  # the same for a logged speed of unknown making: averages and filters of 3 to 30 ms


@dataclass(frozen=True)
class MeasurementLag:
    """δ, what the lag adds to the time constant as it is found: a reading of 63.2 % has nearly all of T = 1/ω_c in it.

    Behind 1/(1 + T s) the step response is 1 - (τ e^(-t/τ) - T e^(-t/T))/(τ - T). That follows from partial fractions; what is
    read off it is found by doing it.
    """

    label: str = "measurement lag"
    law: str = "The lag of a filter behind the encoder adds to the time constant, not to the gain."
    occurrence: float = 0.3
    not_with: tuple[str, ...] = ()

    def sizes(self, question: Question) -> Sizes | Excluded:
        """Known where the chain is; otherwise as probable as the filters are that people use."""
        if "time_constant" not in question.names:
            return Excluded("it doesn't change the gain")
        if question.method is not None and question.method not in BY_HAND:
            return Excluded(f"the effect of the measurement on {question.method} counts as the method's")
        by_eye = BY_EYE if question.origin == "claim" and (question.method or "step_63") in BY_HAND else 0.0
        if question.known_lag is not None:
            return single(question.known_lag, time_constant=by_eye)
        if question.lags is None:
            return Excluded(_why_not(question))
        middle, sd = _CLAIMED if question.origin == "claim" else _RECORDED
        logs = np.linspace(log(question.lags.cutoffs[0]), log(question.lags.cutoffs[-1]), 41)
        extra = np.interp(-logs, *_by_period(question.lags.cutoffs, question.lags.extra))
        weights = np.exp(-0.5 * ((logs - log(middle)) / sd) ** 2)
        return Sizes(
            values=extra,
            weights=weights / weights.sum(),
            steps=np.abs(np.gradient(extra)),
            likely=float(np.interp(-log(middle), *_by_period(question.lags.cutoffs, question.lags.extra))),
            scatter={"time_constant": by_eye},
        )

    def domain(self, question: Question) -> tuple[float, float]:
        """From none to ten time constants."""
        return (0.0, 10 * question.before["time_constant"])

    def effect(self, question: Question, size: float) -> Array:
        """ln(1 + δ/τ), and the delay that a fit makes of it."""
        delay = 0.0
        if question.lags is not None:
            delay = float(np.interp(size, question.lags.extra, question.lags.delays))
        tau = log1p(max(size / question.before["time_constant"], -0.95))
        return question.shift(time_constant=tau, delay=delay)

    def size_text(self, question: Question, size: float) -> str:
        """The cut-off that makes it, where one is looked for, and what it adds."""
        if question.lags is None:
            return f"{with_unit(size, 's', 3)} in the reading"
        return f"a filter of {self.amount(question, size)}, {with_unit(size, 's', 3)} in the figure"

    def amount(self, question: Question, size: float) -> str:
        """The cut-off, or in seconds."""
        if question.lags is None:
            return with_unit(size, "s", 3)
        cutoff = np.exp(np.interp(size, question.lags.extra, np.log(question.lags.cutoffs)))
        beyond = (
            "below " if size > question.lags.extra[-1] else "above " if size < question.lags.extra[0] else ""
        )
        return f"{beyond}{plain(float(cutoff), 2)} rad/s"

    def decision_for(self, question: Question, size: float) -> Decision:
        """Raw counts have no filter."""
        if question.origin == "claim" and question.lags is not None and "time_constant" in question.names:
            bare = with_unit(question.before["time_constant"], "s", 3)
            return Decision(
                sentence="Find out which filter the claimed figure was read through, and read it again without it: "
                f"behind {self.amount(question, size)} this motor reads "
                f"{with_unit(question.after['time_constant'], 's', 3)}, without a filter {bare}."
            )
        return Decision(
            sentence="Record the encoder's raw counts instead of the filtered speed and identify again: a lag of "
            "the measurement disappears, one of the motor stays."
        )


def _by_period(cutoffs: Array, values: Array) -> tuple[Array, Array]:
    """-ln of the cut-offs, rising, and the values at them."""
    order = np.argsort(-cutoffs)
    return -np.log(cutoffs[order]), values[order]


def _why_not(question: Question) -> str:
    if question.origin == "claim":
        return "the method can't be applied: these data have no steps that settle"
    chains = {str(record.data.chain) for record in question.fit.records} - {""}
    known = f"`{' or '.join(sorted(chains))}` is known" if chains else "the data are positions"
    return f"{known}, and the prediction allows for the measurement"


CAUSES.member("measurement_lag")(MeasurementLag())

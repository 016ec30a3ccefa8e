"""A speed without information on its measurement: how much of the delay belongs to the measurement.

A differenced speed lags by half a sample time b, a directly measured one doesn't. The data don't show which it is. The
estimated delay is the motor's plus something between 0 and b: spread evenly, its mean square is b²/3, which is added to the
variance of the delay.

An undeclared filter lags by more. Where the data show two lags, τ₁ > τ₂, either may be the motor's, and a winding's lag and a
filter's look alike. Filters are mostly chosen to be faster than what they filter: if the logarithm of their lag over the motor's
is normal about ln 0.3 with a standard deviation of 1.2, as for the smoothing that sketches and drives come with, the odds that
the longer lag is the filter's are (τ₂/τ₁)^(5/3). What both parameters would change by counts with that chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from servobench.core.finding import Finding, info
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_FALL = 5.0 / 3.0  # of the odds with the ratio of the lags: 2 · ln(1/0.3)/1.2²
EITHER_LAG: Final = "which lag is the motor's"
_LAGS = ("time_constant", "electrical_time_constant")


def with_unknown_chain(fit: Fit) -> Fit:
    """Return the fit with lines of its budget for what an unknown measurement may lag by: half a sample, or one of two lags."""
    hidden = max((0.5 * r.data.sample_time for r in fit.records if is_unknown(r.data)), default=0.0)
    return _with_half_sample(_with_either_lag(fit), hidden) if hidden else fit


def _with_either_lag(fit: Fit) -> Fit:
    """The fit with a line for the chance that the longer of two lags is a filter's, and the shorter one the motor's."""
    if not set(_LAGS) <= set(fit.model.names):
        return fit
    at = [fit.model.names.index(name) for name in _LAGS]
    own, second = (float(fit.model.theta[n]) for n in at)
    if not 0.0 < second < own:
        return fit
    odds = (second / own) ** _FALL
    exchange = np.zeros(len(fit.model.theta))
    exchange[at] = second - own, own - second
    return fit.widen(
        Contribution(
            source=EITHER_LAG,
            covariance=odds / (1.0 + odds) * np.outer(exchange, exchange),
            reason="it isn't known how the speed was measured; the longer of the two lags may be a filter's",
        )
    )


def _with_half_sample(fit: Fit, hidden: float) -> Fit:
    """The fit with a line for a lag of the measurement between none and `hidden` [s]."""
    if "delay" not in fit.model.names:
        return fit
    added = np.zeros_like(fit.covariance)
    at = fit.model.names.index("delay")
    added[at, at] = hidden**2 / 3.0
    reason = (
        "it isn't known how the speed was measured; a speed differenced from counts lags by half a sample"
    )
    return fit.widen(Contribution(source="measurement unknown", covariance=added, reason=reason))


def is_unknown(data: Dataset) -> bool:
    """Return whether it isn't known how a speed was measured."""
    return data.kind == "speed" and not data.chain and not data.chain_known


def _of_each(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _chain_unknown(record)]


def _chain_unknown(data: Dataset) -> list[Finding]:
    """Whether a speed comes without word of how it was measured."""
    findings = []
    if is_unknown(data):
        findings.append(
            info(
                "chain-unknown",
                f"{data.name}: it isn't known how this speed was measured, so the time constant "
                "and delay include the lag of the measurement. Differenced counts add half a sample "
                f"({500 * data.sample_time:.3g} ms), a filter or an average its own lag; name "
                "the chain with `chain=...`, or record the position.",
                parameters=("time_constant", "delay"),
            )
        )
    return findings


DOUBTS.member("chain_unknown")(Doubt(codes=("chain-unknown",), about_data=_of_each))

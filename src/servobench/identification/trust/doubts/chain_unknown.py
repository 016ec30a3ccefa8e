"""A speed without information on its measurement: how much of the delay belongs to the measurement.

A differenced speed lags by half a sample time b, a directly measured one doesn't. The data don't show which it is. The
estimated delay is the motor's plus something between 0 and b: spread evenly, its mean square is b²/3, which is added to the
variance of the delay. An undeclared filter lags by more, and can't be allowed for.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.finding import Finding, info
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset


def with_unknown_chain(fit: Fit) -> Fit:
    """Return the fit with the delay's variance larger by the half sample that an unknown measurement may lag by."""
    hidden = max((0.5 * r.data.sample_time for r in fit.records if is_unknown(r.data)), default=0.0)
    if not hidden or "delay" not in fit.model.names:
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

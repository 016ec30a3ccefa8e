"""A motor that turns against its input."""

from __future__ import annotations

from servobench.core.finding import Finding, info
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt


def _sense(fit: Fit) -> list[Finding]:
    if "gain" not in fit.model.names:
        return []
    gain = fit["gain"]
    # The sign of a gain that may be zero is unknown.
    if gain.value >= 0 or not 2 * gain.sd < -gain.value:
        return []
    return [
        info(
            "sign-negative",
            "A positive input turns the motor in the negative direction.",
            parameters=("gain",),
        )
    ]


DOUBTS.member("sense")(Doubt(codes=("sign-negative",), about_fit=_sense))

"""A motor that turns against its input."""

from __future__ import annotations

from servobench.doubts.base import DOUBTS, Doubt
from servobench.estimators.base import Fit
from servobench.finding import Finding, info


def _sense(fit: Fit) -> list[Finding]:
    if "gain" not in fit.model.names:
        return []
    if fit["gain"].value >= 0:
        return []
    return [
        info(
            "sign-negative",
            "A positive input turns the motor in the negative direction.",
            parameters=("gain",),
        )
    ]


DOUBTS.member("sense")(Doubt(codes=("sign-negative",), about_fit=_sense))

"""A simulation that explains little."""

from __future__ import annotations

from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt


def _poor(fit: Fit) -> list[Finding]:
    if fit.fit_percent >= 50:
        return []
    return [
        warning(
            "fit-poor",
            f"The simulation explains only {fit.fit_percent:.0f} % of the output: this isn't the right model, or these "
            "aren't the right columns.",
        )
    ]


DOUBTS.member("fit_poor")(Doubt(codes=("fit-poor",), about_fit=_poor))

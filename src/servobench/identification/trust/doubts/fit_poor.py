"""A simulation that explains little."""

from __future__ import annotations

from servobench.core.finding import Finding, warning
from servobench.core.rounding import share_explained
from servobench.identification.estimators.base import Fit
from servobench.identification.models.motion import steady_speed
from servobench.identification.trust.doubts.base import DOUBTS, Doubt


def _poor(fit: Fit) -> list[Finding]:
    # Of a motor that turns at one speed in each record, noise is all that is left to explain beside the mean.
    if fit.fit_percent >= 50 or all(steady_speed(record.data) is not None for record in fit.records):
        return []
    return [
        warning(
            "fit-poor",
            f"The simulation explains {share_explained(fit.fit_percent)} of the output: the model or the "
            "columns are wrong.",
        )
    ]


DOUBTS.member("fit_poor")(Doubt(codes=("fit-poor",), about_fit=_poor))

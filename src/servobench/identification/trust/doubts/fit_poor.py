"""A simulation that explains little."""

from __future__ import annotations

from servobench.core.finding import Finding, warning
from servobench.core.rounding import share_explained
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt


def _poor(fit: Fit) -> list[Finding]:
    # Under a steady input a steady output is its own mean, and what is left to explain is noise.
    if fit.fit_percent >= 50 or all(record.data.has_steady_input for record in fit.records):
        return []
    return [
        warning(
            "fit-poor",
            f"The simulation explains {share_explained(fit.fit_percent)} of the output: the model or the "
            "columns are wrong.",
        )
    ]


DOUBTS.member("fit_poor")(Doubt(codes=("fit-poor",), about_fit=_poor))

"""Gain and time constant that the data hardly tell, or not at all."""

from __future__ import annotations

import numpy as np

from servobench.doubts import lag_not_split
from servobench.doubts.base import DOUBTS, Doubt
from servobench.estimators.base import Fit
from servobench.finding import Finding, refusal, warning

_SAID = (
    "scatter-unknown",
    "single-level",
)  # findings that say by themselves why a standard deviation is infinite


def _uncertain(fit: Fit) -> list[Finding]:
    """Whether gain and time constant are known at all, and how well."""
    found = []
    codes = {finding.code for finding in fit.findings}
    told = not codes.isdisjoint(_SAID)
    for name in ("gain", "time_constant"):
        if name not in fit.model.names or (name == "time_constant" and lag_not_split.CODE in codes):
            continue
        estimate = fit[name]
        if told and not np.isfinite(estimate.sd):
            continue
        relative = estimate.sd / abs(estimate.value) if estimate.value else np.inf
        if not relative < 0.5:
            found.append(
                refusal(
                    "parameter-unknown",
                    f"The data don't tell the {name.replace('_', ' ')}: {estimate.value:.3g} {estimate.unit} with a standard "
                    f"deviation of {estimate.sd:.3g}; record steps between several levels, each longer than the motor takes.",
                    parameters=(name,),
                )
            )
        elif relative > 0.05:
            sentence = f"The {name.replace('_', ' ')} is known to ±{196 * relative:.0f} % only."
            found.append(warning("parameter-uncertain", sentence, parameters=(name,)))
    return found


DOUBTS.member("uncertain")(Doubt(codes=("parameter-unknown", "parameter-uncertain"), about_fit=_uncertain))

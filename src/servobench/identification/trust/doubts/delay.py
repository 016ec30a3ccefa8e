"""An output that comes before its cause."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, Severity, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

# Of a shaft that carries its load by a spring, the zeros lead: a fast pole and a delay of minus its time constant together follow
# the input at once. Their sum says when the output begins.
_LAGS = ("delay", "electrical_time_constant")


def _delay(fit: Fit) -> list[Finding]:
    """Whether the output comes before its cause, and the search hasn't said so already."""
    names = fit.model.names
    if "delay" not in names:
        return []
    # Nothing else is in the sum: what isn't known has an infinite variance.
    summed = [at for at, name in enumerate(names) if name in _LAGS]
    lag = float(fit.model.theta[summed].sum())
    # The two may be known as a sum only: its variance can then be rounding error, of either sign.
    sd = float(np.sqrt(max(fit.covariance[np.ix_(summed, summed)].sum(), 0.0)))
    reported = any(f.parameters == ("delay",) and f.severity is Severity.WARNING for f in fit.findings)
    if reported or lag >= -0.6 * fit.records[0].data.sample_time:
        return []
    if lag >= -3 * sd and not _is_ahead_of_all(fit):
        return []
    least = "at least " if _is_at_its_shortest(fit) else ""
    sentence = f"The output comes {least}{-lag:.3g} s before the input that causes it: the two columns are misaligned."
    return [warning("delay-negative", sentence, parameters=("delay",))]


def _is_ahead_of_all(fit: Fit) -> bool:
    """Whether the delay ends at the shortest that misaligned columns allow, and the time constant below what samples resolve.

    Neither leaves any lag to the motor then, and the output would come earlier still: the delay's own interval, which no longer
    says what the data do, may reach to zero.
    """
    step = fit.records[0].data.sample_time
    has_no_lag = "time_constant" in fit.model.names and fit.model["time_constant"] < step
    return has_no_lag and _is_at_its_shortest(fit)


def _is_at_its_shortest(fit: Fit) -> bool:
    """Whether the delay ends at the shortest that misaligned columns allow: what is farther out of step looks the same."""
    shortest = fit.model.structure.bounds([record.data for record in fit.records])[0]
    return bool(fit.model["delay"] <= shortest[fit.model.names.index("delay")])


DOUBTS.member("delay")(Doubt(codes=("delay-negative",), about_fit=_delay))

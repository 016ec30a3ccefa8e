"""An output that comes before its cause."""

from __future__ import annotations

from servobench.core.finding import Finding, Severity, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt


def _delay(fit: Fit) -> list[Finding]:
    """Whether the output comes before its cause, and the search hasn't said so already."""
    if "delay" not in fit.model.names:
        return []
    delay, step = fit["delay"], fit.records[0].data.sample_time
    told = any(f.parameters == ("delay",) and f.severity is Severity.WARNING for f in fit.findings)
    if told or delay.value >= -3 * delay.sd or delay.value >= -0.6 * step:
        return []
    sentence = (
        f"The output comes {-delay.value:.3g} s before the input that causes it: the "
        "two columns are misaligned."
    )
    return [warning("delay-negative", sentence, parameters=("delay",))]


DOUBTS.member("delay")(Doubt(codes=("delay-negative",), about_fit=_delay))

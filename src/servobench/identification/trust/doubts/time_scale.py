"""A time constant that is too short for the sampling, or too long for the record."""

from __future__ import annotations

from servobench.core.finding import Finding, info
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts import lag_not_split
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_FAR = 10.0  # times the longest record: what is longer is no number that anybody needs


def _time_scale(fit: Fit) -> list[Finding]:
    """Whether the time constant lies between the sample time and the length of the record."""
    if "time_constant" not in fit.model.names:
        return []
    tau = fit.model["time_constant"]
    step = max(record.data.sample_time for record in fit.records)
    # Of a closed loop only the stretches of motion may be there: all of them follow one another in one record.
    together = sum if any(record.data.closed_loop for record in fit.records) else max
    longest = together(record.data.duration for record in fit.records)
    split_unknown = any(finding.code == lag_not_split.CODE for finding in fit.findings)
    if tau < 2 * step and not split_unknown:
        sentence = (
            f"The time constant that fits best, {with_unit(tau, 's', 3)}, is less than two sample times of "
            f"{with_unit(step, 's', 3)}: sample faster."
        )
        return [info("sampling-too-slow", sentence, parameters=("time_constant",))]
    if tau > 0.5 * longest:
        best = f", {with_unit(tau, 's', 3)}, is" if tau < _FAR * longest else " is far"
        sentence = f"The time constant that fits best{best} longer than half of the longest record: record for longer."
        return [info("record-too-short", sentence, parameters=("time_constant", "gain"))]
    return []


DOUBTS.member("time_scale")(Doubt(codes=("sampling-too-slow", "record-too-short"), about_fit=_time_scale))

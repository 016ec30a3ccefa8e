"""The statements of an answer as plain data: parameters and combinations with their intervals, bounds, and the intervals'
sources.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from servobench.identification.result import Result

Statement = tuple[float, float, float, float]
"""Value, standard deviation, and the ends of the 95 % interval."""

_TWO_SIDED = 1.959964
_SHOWN = 1e-3  # relative: how exactly a combination's words give the voltage that it is of


def said(result: Result) -> dict[str, Any]:
    """Return verdict, findings, statements and the budget of gain and time constant.

    `estimates` holds the parameters that are known and the combinations; the lag also where it follows from both of its parts.
    `bounds` are the intervals of those that are bounded, `level` is the voltage of the speed that is stated [V].
    """
    findings: dict[str, list[str]] = {}
    for finding in result.findings:
        findings.setdefault(str(finding.severity), []).append(finding.code)
    row: dict[str, Any] = {"verdict": str(result.verdict), "findings": findings}
    if result.fit is None:
        return row
    together = {each.name: _statement(each.estimate) for each in result.combinations}
    known = {name: _statement(a.estimate) for name, a in result.answers.items() if str(a.state) == "known"}
    return row | {
        "structure": result.fit.structure,
        "estimator": result.fit.estimator,
        "fit_percent": result.fit.fit_percent,
        "states": {name: str(answer.state) for name, answer in result.answers.items()},
        "combinations": sorted(together),
        "estimates": _lag(result, known) | known | together,
        "bounds": {n: list(a.estimate.interval) for n, a in result.answers.items() if str(a.state) == "bounded"},
        "level": _level(result),
        "budget": {
            name: {line.source: line.shares[name] for line in result.budget if name in line.shares}
            for name in ("gain", "time_constant")
        },
    }  # fmt: skip


def _statement(estimate: Any) -> Statement:
    return (estimate.value, estimate.sd, *estimate.interval)


def _lag(result: Result, known: dict[str, Statement]) -> dict[str, Statement]:
    """Time constant plus delay, where both are known."""
    fit = result.fit
    if (
        fit is None
        or not {"time_constant", "delay"} <= set(known)
        or "electrical_time_constant" in fit.model.names
    ):
        return {}
    at = [list(fit.model.names).index(name) for name in ("time_constant", "delay")]
    value = float(fit.model.theta[at].sum())
    sd = math.sqrt(max(float(np.sum(fit.covariance[np.ix_(at, at)])), 0.0))
    return {"lag": (value, sd, value - _TWO_SIDED * sd, value + _TWO_SIDED * sd)}


def _level(result: Result) -> float:
    """The voltage of the speed that is stated [V], exactly where the words' few digits and the model agree on it; else NaN."""
    stated = [each for each in result.combinations if each.name == "speed_at_level"]
    if not stated or result.fit is None:
        return math.nan
    shown = float(stated[0].meaning.split()[2].replace("−", "-"))  # printed as people write it
    values = dict(zip(result.fit.model.names, result.fit.model.theta, strict=True))
    lost = float(values[stated[0].parameters[1]])
    reached = stated[0].estimate.value / float(values["gain"])
    exact = [level for level in (reached + lost, reached - lost) if abs(level - shown) <= _SHOWN * abs(shown)]
    return exact[0] if exact else shown

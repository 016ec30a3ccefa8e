"""Each real recording identified alone: verdict, estimates with intervals, findings, processor time."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from real_parts.recordings import RealRecording
from servobench.core.errors import ServobenchError
from servobench.core.finding import Severity
from servobench.core.rounding import TWO_SIDED
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.uncertainty.identifiability import State

PARAMETERS = ("gain", "time_constant", "lag", "coulomb_voltage")
_HELD_OUT = ("lag", "acceleration")  # combinations that are the same in all recordings of a motor


@dataclass(frozen=True, kw_only=True)
class Stated:
    """A value and the half-width of its 95 % interval, in the unit of the data."""

    value: float
    half_width: float
    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Return whether the interval holds a value."""
        return self.low <= value <= self.high


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The outcome of identification for one recording alone.

    `verdict` is "unread" where the file couldn't be read. `stated` holds the parameters that have an interval: gain, time
    constant, `lag` (time constant + delay) and Coulomb voltage. `seconds` is processor time [s].
    """

    motor: str
    name: str
    verdict: str
    stated: Mapping[str, Stated]
    warnings: tuple[str, ...] = ()
    findings: int = 0
    fit_percent: float = math.nan
    seconds: float = 0.0


def outcomes(
    recordings: Iterable[RealRecording], show: Callable[[Outcome], None] = lambda outcome: None
) -> tuple[Outcome, ...]:
    """Return what is said of each recording alone; `show` sees each as soon as it's there."""
    found = []
    for recording in recordings:
        found.append(_outcome(recording))
        show(found[-1])
    return tuple(found)


def _outcome(recording: RealRecording) -> Outcome:
    started = time.process_time()
    try:
        result = identify(recording.dataset())
    except ServobenchError as error:
        return Outcome(
            motor=recording.motor, name=recording.name, verdict="unread", stated={}, warnings=(str(error),)
        )
    grave = tuple(each.code for each in result.findings if each.severity is not Severity.INFO)
    return Outcome(
        motor=recording.motor,
        name=recording.name,
        verdict=str(result.verdict),
        stated={} if result.fit is None or str(result.verdict) == "refused" else _stated(result),
        warnings=grave,
        findings=len(result.findings),
        fit_percent=math.nan if result.fit is None else result.fit.fit_percent,
        seconds=time.process_time() - started,
    )


def _stated(result: Result) -> dict[str, Stated]:
    """The statements of a result: known parameters, combinations, and the lag if both of its parts are known."""
    answers = result.answers
    found = {
        name: _from(*answers[name].estimate.interval, answers[name].estimate.value)
        for name in PARAMETERS
        if name in answers and answers[name].state is State.KNOWN
    }
    for each in result.combinations:
        if each.name in _HELD_OUT:
            found[each.name] = _from(*each.estimate.interval, each.estimate.value)
    if {"time_constant", "delay"} <= set(answers) and "time_constant" in found and result.fit is not None:
        fit = result.fit
        pair = [fit.model.names.index(name) for name in ("time_constant", "delay")]
        half = TWO_SIDED * math.sqrt(max(float(np.sum(fit.covariance[np.ix_(pair, pair)])), 0.0))
        lag = float(fit.model.theta[pair].sum())
        found["lag"] = _from(lag - half, lag + half, lag)
    return {name: one for name, one in found.items() if math.isfinite(one.half_width)}


def _from(low: float, high: float, value: float) -> Stated:
    return Stated(value=value, half_width=0.5 * (high - low), low=low, high=high)

"""A lag that the data can't split into time constant and delay.

A motor with time constant τ and delay d lags by τ + d behind an input that is slow compared with both; to first order only this
sum shows. The first moments after a step separate the two, but a coarse sensor hides them. Then the sum may be well known
although neither of the two is. If the sensor isn't the reason, the input or the model is, and not even the sum is known.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.finding import Finding, info
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.resolution import is_coarse

CODE = "lag-not-split"
_UNKNOWN = 0.5  # of its value: a parameter with a larger standard deviation isn't known
_SAMPLES = 10.0  # a lag that lasts for fewer may be hidden by the sampling alone
_EXPLAINED = 80.0  # percent of the output: a model that explains less is another motor's


def widen_for_lag_split(fit: Fit) -> Fit:
    """Return the fit, widened for any split of the lag into time constant and delay if a coarse sensor only shows their sum.

        C' = C + s² v v',   v = ∂θ/∂τ at constant τ + d

    It follows from a split that is off by s moving θ by s v. s² is the mean square distance of a time constant from the
    estimate, all being as likely between none and the whole lag. The sum keeps its standard deviation. The intervals of the two
    hold every such split, and that of the time constant ends where the sum's does, if the delay is as short as can be.
    """
    if not _is_only_sum_known(fit):
        return fit
    names, theta, tau = fit.model.names, fit.model.theta, fit["time_constant"]
    at, late = names.index("time_constant"), names.index("delay")
    lag, half = float(theta[at] + theta[late]), TWO_SIDED * float(np.sqrt(_variance(fit)))
    lower, _ = fit.model.structure.bounds([record.data for record in fit.records])
    none, whole = float(lower[at]), lag - float(lower[late])
    spread = ((whole - tau.value) ** 3 - (none - tau.value) ** 3) / (3 * (whole - none))
    split = np.zeros(len(theta))
    split[at], split[late] = 1.0, -1.0
    longest = whole + half
    intervals = {
        **fit.intervals,
        "time_constant": (none, longest),
        "delay": (float(lower[late]), max(fit["delay"].interval[1], lag + half)),
    }
    reason = (
        "a coarse sensor hides the first moments after a step, which separate the time "
        "constant from the delay"
    )
    line = Contribution(source="lag not split", covariance=spread * np.outer(split, split), reason=reason)
    findings = (*fit.findings, _finding(lag, half, longest))
    return replace(fit.widen(line), intervals=intervals, findings=findings)


def _variance(fit: Fit) -> float:
    """The variance of time constant + delay [s²]; infinite where that of one is."""
    at = [fit.model.names.index(name) for name in ("time_constant", "delay")]
    covariance = fit.covariance[np.ix_(at, at)]
    return float(covariance.sum()) if np.isfinite(covariance).all() else np.inf


def _is_only_sum_known(fit: Fit) -> bool:
    """Whether gain and lag are known, the time constant isn't, and a coarse sensor is the reason."""
    if not {"gain", "time_constant", "delay"} <= set(fit.model.names) or not fit.converged:
        return False
    tau, step = fit.model["time_constant"], max(record.data.sample_time for record in fit.records)
    lag = tau + fit.model["delay"]
    known_apart = fit.sd("time_constant") < _UNKNOWN * tau
    if known_apart or not fit.sd("gain") < _UNKNOWN * abs(fit.model["gain"]):
        return False
    known = 0 <= _variance(fit) < (_UNKNOWN * lag) ** 2 and lag > _SAMPLES * step
    return known and fit.fit_percent > _EXPLAINED and is_coarse(fit)


def _finding(lag: float, half: float, longest: float) -> Finding:
    sentence = (
        f"The data determine only the sum of the time constant and the delay, {lag:.3g} ± "
        f"{half:.2g} s; the time constant may be anything up to {longest:.2g} s. Record steps with "
        "a finer sensor: the first moments after a step separate the two."
    )
    return info(CODE, sentence, parameters=("time_constant", "delay"))


DOUBTS.member("lag_not_split")(Doubt(codes=(CODE,)))

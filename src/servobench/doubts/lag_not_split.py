"""A lag of which the data don't tell how much is the time constant and how much is a delay.

A motor of time constant τ behind a delay d lags by τ + d behind any input that is slow beside both: to first order nothing else
of the two can be seen. Which it is shows in the first moments after a step; a coarse sensor, or a model that is a little wrong,
hides just those. Then the sum may be well known where neither of the two is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.doubts.base import DOUBTS, Doubt
from servobench.estimators.base import Fit
from servobench.finding import Finding, warning

CODE = "lag-not-split"
_UNKNOWN = 0.5  # of its value: a parameter with a larger standard deviation isn't known
_SAMPLES = 10.0  # a lag that lasts for fewer may be hidden by the sampling alone
_TWO_SIDED = 1.959964


def with_what_the_lag_tells(fit: Fit) -> Fit:
    """Return the fit, with any split of the lag into time constant and delay where only their sum is known.

        C' = C + s² v v',   v = ∂θ/∂τ at constant τ + d

    s² is the mean square distance of a time constant from the estimate, all being as likely between none and the whole lag. The
    sum keeps its standard deviation. The intervals of the two hold what they held before and every such split.
    """
    names = fit.model.names
    if not {"gain", "time_constant", "delay"} <= set(names) or not fit.converged:
        return fit
    at, late = names.index("time_constant"), names.index("delay")
    if not np.isfinite(fit.covariance[np.ix_([at, late], [at, late])]).all():
        return fit
    theta, covariance = fit.model.theta, fit.covariance
    lag = float(theta[at] + theta[late])
    variance = float(covariance[at, at] + covariance[late, late] + 2 * covariance[at, late])
    step = max(record.data.sample_time for record in fit.records)
    known = 0 <= variance < (_UNKNOWN * lag) ** 2 and lag > _SAMPLES * step
    gain, tau = fit["gain"], fit["time_constant"]
    if tau.sd < _UNKNOWN * tau.value or not gain.sd < _UNKNOWN * abs(gain.value) or not known:
        return fit
    lower, _ = fit.model.structure.bounds([record.data for record in fit.records])
    none, whole = float(lower[at]), lag - float(lower[late])
    spread = ((whole - tau.value) ** 3 - (none - tau.value) ** 3) / (3 * (whole - none))
    split = np.zeros(len(theta))
    split[at], split[late] = 1.0, -1.0
    half = _TWO_SIDED * float(np.sqrt(variance))
    low, high = fit["time_constant"].interval
    longest = max(high, whole + half)
    earliest, latest = fit["delay"].interval
    intervals = {
        **fit.intervals,
        "time_constant": (max(min(low, none), none), longest),
        "delay": (max(min(earliest, float(lower[late])), float(lower[late])), max(latest, lag + half)),
    }
    return replace(
        fit,
        covariance=covariance + spread * np.outer(split, split),
        intervals=intervals,
        findings=(*fit.findings, _said(lag, half, longest)),
    )


def _said(lag: float, half: float, longest: float) -> Finding:
    sentence = (
        f"The data tell the time constant and the delay by their sum only: together they are {lag:.3g} ± {half:.2g} s, of which "
        f"the time constant may be anything up to {longest:.2g} s. Which of the two it is shows in the first moments after a "
        "step; record steps with a finer sensor to tell them apart."
    )
    return warning(CODE, sentence, parameters=("time_constant", "delay"))


DOUBTS.member("lag_not_split")(Doubt(codes=(CODE,)))

"""A time constant that isn't resolved: what hangs together with it is held to be known only for the whole of what it may be.

Behind a ramp only the sum of the friction u_c and the lag a τ of a slope a is known. Where the interval of τ is wider than half
of its value the answer is a bound from above (`answers`): it may be anything down to zero; where there is no answer, anything up
to its interval's upper end, or the record's length. By the normal law the others follow it with the slope C_iτ / C_ττ, and get
the variance that they lack until 95 % of the intervals reach as far.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.uncertainty.identifiability import State, parameter_statuses

SOURCE: Final = "time constant not resolved"
_OPEN = (State.BOUNDED, State.UNKNOWN)


def with_unresolved_time_constant(fit: Fit) -> Fit:
    """Return the fit with a line of its budget where its time constant is only bounded, or not known; else the same."""
    if "time_constant" not in fit.model.names:
        return fit
    at = fit.model.names.index("time_constant")
    variance, value = float(fit.covariance[at, at]), float(fit.model.theta[at])
    answer = parameter_statuses(fit, ("time_constant",))["time_constant"]
    if answer.state not in _OPEN or not 0 < variance < np.inf:
        return fit
    reach = value
    if answer.state is State.UNKNOWN:
        longest = max(record.data.duration for record in fit.records)
        reach = max(value, min(answer.estimate.interval[1], longest) - value)
    lacking = (reach / TWO_SIDED) ** 2 - variance
    if not lacking > 0:
        return fit
    slope = np.where(np.isfinite(np.diag(fit.covariance)), fit.covariance[:, at] / variance, 0.0)
    reason = "the time constant isn't known by itself, and what varies with it is known no better"
    return fit.widen(Contribution(source=SOURCE, covariance=lacking * np.outer(slope, slope), reason=reason))

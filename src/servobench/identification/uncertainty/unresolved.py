"""A time constant that isn't resolved: what hangs together with it is held to be known only for the whole of what it may be.

Behind a ramp the friction u_c and the lag a τ of a slope a are told as their sum only. Where the interval of τ is wider than half
of its value the answer is a bound from above (`answers`): it may be anything down to zero. By the normal law the others follow it
with the slope C_iτ / C_ττ, and get the variance that they lack until 95 % of the intervals reach zero.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.uncertainty.answers import State, answers

SOURCE: Final = "time constant not resolved"
_OPEN = (State.BOUNDED, State.UNKNOWN)


def with_unresolved_time_constant(fit: Fit) -> Fit:
    """Return the fit with a line of its budget where its time constant is only bounded from above; else the same."""
    if "time_constant" not in fit.model.names:
        return fit
    at = fit.model.names.index("time_constant")
    variance = float(fit.covariance[at, at])
    lacking = (float(fit.model.theta[at]) / TWO_SIDED) ** 2 - variance
    if not (0 < variance < np.inf and lacking > 0) or answers(fit)["time_constant"].state not in _OPEN:
        return fit
    slope = np.where(np.isfinite(np.diag(fit.covariance)), fit.covariance[:, at] / variance, 0.0)
    reason = "the data tell the time constant only from above, and what goes with it isn't known any better"
    return fit.widened(
        Contribution(source=SOURCE, covariance=lacking * np.outer(slope, slope), reason=reason)
    )

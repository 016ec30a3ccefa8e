"""The uncertainty of the delay due to a computer's clock: when, within a read or a write, the device acted.

Sample k is latched at some time during the read, and the voltage acts from some time during the write. The recorded times of
the output are the earliest possible, those of the input the latest, so on average the delay is too short by something between 0
and the length b of the two calls. The data can't separate this from a delay of the motor. Spread evenly over this span, its
mean square is b²/3, which is added to the delay's variance. Gain and time constant don't change, because the delay absorbs what
is the same for all samples.
"""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info
from servobench.core.rounding import microseconds
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_WORTH_A_WORD = 0.5  # of the standard deviation of the delay


def widen_for_host_delay(fit: Fit) -> Fit:
    """Return the fit with the uncertainty of the read and write times added to the delay's variance."""
    hidden = _host_delay(fit)
    if not hidden:
        return fit
    added = np.zeros_like(fit.covariance)
    at = fit.model.names.index("delay")
    added[at, at] = hidden**2 / 3.0
    reason = "it isn't known when the device acted within a read or a write"
    return fit.widen(Contribution(source="reading and writing", covariance=added, reason=reason))


def _host_delay(fit: Fit) -> float:
    """The longest time that the delay may be too short by [s]; 0 for a model without one."""
    return max(record.data.hidden_delay for record in fit.records) if "delay" in fit.model.names else 0.0


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether the computer has much of a part in how well the delay is known."""
    hidden = _host_delay(fit)
    if not hidden:
        return []
    if not hidden / np.sqrt(3.0) > _WORTH_A_WORD * fit.sd("delay"):
        return []
    sentence = (
        f"The computer needed {microseconds(hidden)} µs to read the sensors and write the voltage, "
        "and it isn't known when within that time the device acted. The delay may be longer by as "
        "much; its interval allows for that."
    )
    return [info("delay-within-a-call", sentence, parameters=("delay",))]


DOUBTS.member("host_delay")(Doubt(codes=("delay-within-a-call",), about_fit=_about_fit))

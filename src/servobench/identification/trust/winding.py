"""Do the data separate the lag of the winding from a delay? If not, a second-order structure is refused even if named.

At a constant sum of delay and lag the output changes with the square of the lag only (the second moment of its impulse
response), so that near zero neither the lag nor its interval means anything: what is known is τ_e², and its standard deviation
is 2 τ_e times that of τ_e. It has to be four of those away from zero, so τ_e eight of its own.
"""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, refusal, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.chain_unknown import EITHER_LAG

_AWAY = 8.0  # standard deviations of τ_e that it has to lie above zero
_NEARLY_HALF = 0.45  # of τ: from there on the two poles are as good as one, or complex


def about_winding(fit: Fit) -> list[Finding]:
    """Return what is to be known of a fitted `electrical_time_constant`; nothing for a structure without one.

    `electrical-pole-not-told` refuses a lag that the data can't distinguish from a delay; `poles-not-apart` doubts one so near
    the time constant that the motor may swing.
    """
    if "electrical_time_constant" not in fit.model.names:
        return []
    lag, tau = fit.model["electrical_time_constant"], fit.model["time_constant"]
    if not lag > _AWAY * sd_of_second_lag(fit):
        step = max(record.data.sample_time for record in fit.records)
        whole = lag + (fit.model["delay"] if "delay" in fit.model.names else 0.0)
        sentence = (
            "These data can't separate the winding's lag from a delay: together they are "
            f"{whole:.3g} s, at a sample time of {step:.3g} s and this resolution. Use the "
            "first-order structure, whose delay covers both, or record a frequently changing "
            "input faster, longer or with a finer encoder."
        )
        return [
            refusal("electrical-pole-not-told", sentence, parameters=("electrical_time_constant", "delay"))
        ]
    if lag > _NEARLY_HALF * tau:
        sentence = (
            f"The electrical time constant, {lag:.3g} s, is nearly half of the time constant, "
            f"{tau:.3g} s: beyond that the poles are complex and these two no longer describe the "
            "motor. Compare `structure=rational_2_0_integrator_delay`."
        )
        return [
            warning("poles-not-apart", sentence, parameters=("electrical_time_constant", "time_constant"))
        ]
    return []


def sd_of_second_lag(fit: Fit) -> float:
    """Return the standard deviation of the second lag [s] if it is the shorter one for certain.

    That either may be the motor's (`trust.doubts.chain_unknown`) is no doubt that there are two.
    """
    at = fit.model.names.index("electrical_time_constant")
    exchanged = sum(float(line.covariance[at, at]) for line in fit.budget if line.source == EITHER_LAG)
    return float(np.sqrt(max(fit.covariance[at, at] - exchanged, 0.0)))

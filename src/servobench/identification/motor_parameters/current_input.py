"""The meaning of a model whose input is the current: J dω/dt = k i - b ω - T_c sgn(ω), without winding and back-emf.

K = k/b, τ = J/b and K/τ = k/J follow from this equation while the shaft slides.
"""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info
from servobench.core.rounding import TWO_SIDED, rounded_interval
from servobench.core.units import is_unit, unit
from servobench.identification.estimators.base import Fit

_KNOWN = 0.5  # of the ratio: half-width of a 95 % interval up to which it is worth stating


def about_current_input(fit: Fit) -> list[Finding]:
    """Return what gain and time constant are where the input is a current, and k/J = K/τ with its interval; nothing otherwise."""
    data = fit.records[0].data
    driven = is_unit(data.input_unit) and unit(data.input_unit).quantity == "current"
    if not driven or not {"gain", "time_constant"} <= set(fit.model.names):
        return []
    gain, tau = fit.model["gain"], fit.model["time_constant"]
    places = [fit.model.names.index("gain"), fit.model.names.index("time_constant")]
    # d ln(K/τ) = dK/K - dτ/τ
    slope = np.array([1.0 / gain, -1.0 / tau])
    relative = float(np.sqrt(max(slope @ fit.covariance[np.ix_(places, places)] @ slope, 0.0)))
    sentence = (
        "The input is a current, so the model has no back-emf: the time constant is J/b and the gain k/b, much "
        "larger than for the same motor driven by a voltage."
    )
    if TWO_SIDED * relative <= _KNOWN:
        ratio, half = gain / tau, TWO_SIDED * relative * abs(gain / tau)
        text = rounded_interval(
            ratio, (ratio - half, ratio + half), f"{data.position_unit}/(s²·{data.input_unit})"
        )
        sentence += f" Such data determine their ratio best: k/J = {text}."
    return [info("input-is-a-current", sentence, parameters=("gain", "time_constant"))]

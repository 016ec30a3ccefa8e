"""The possible size of each parameter, for a prior so weak that it only counts if the data say nothing.

If the data only determine two parameters together, such as gain and friction at one level, a covariance without a prior has
entries millions of times too large, and rounding errors spoil the combination that is known. With a normal prior of variance P
it is (J'J/s² + P⁻¹)⁻¹ (Lindley and Smith 1972).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit

WEAK: Final = 3.0
"""Times its size: the standard deviation of the weak prior of each parameter."""


def sizes(fit: Fit) -> Array:
    """Return a size (P + ΣQ,) for each entry of the joint vector, in its unit: none of them is far from what is possible."""
    lag = abs(fit.model["time_constant"]) or 1.0
    return np.array([*_of_shared(fit, lag), *_of_records(fit, lag)])


def friction_spread(fit: Fit) -> float:
    """Return the standard deviation of the Coulomb voltage as a part of the largest input; 0 for a model without friction."""
    return fit.sd("coulomb_voltage") / _largest_input(fit) if "coulomb_voltage" in fit.model.names else 0.0


def _largest_input(fit: Fit) -> float:
    return max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records) or 1.0


def _of_shared(fit: Fit, lag: float) -> list[float]:
    largest = _largest_input(fit)
    least = {"delay": lag, "time_constant": lag}
    return [
        max(abs(float(value)), least.get(name, 0.1 * largest if name.endswith("voltage") else 0.0)) or 1.0
        for name, value in zip(fit.model.names, fit.model.theta, strict=True)
    ]


def _of_records(fit: Fit, lag: float) -> list[float]:
    own = []
    for record in fit.records:
        spread = float(np.ptp(record.data.y)) or 1.0
        rate = spread / lag if record.data.kind == "position" else spread
        own += [max(abs(float(v)), rate if n else spread) for n, v in enumerate(record.nuisance)]
    return own

"""What size a parameter may have at all: for a prior so weak that it counts only where the data tell nothing.

Where two parameters are told together only, such as gain and friction under one level, a covariance without a prior has entries
that are millions of times what is possible, and rounding error in what is known of the two together. With a normal prior of
variance P it is (J'J/s² + P⁻¹)⁻¹ (Lindley and Smith 1972).
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


def _of_shared(fit: Fit, lag: float) -> list[float]:
    largest = max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records) or 1.0
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

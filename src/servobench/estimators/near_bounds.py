"""Intervals of parameters near a bound, by profile likelihood: there, value ± 1.96 sd would reach beyond what is possible.

The profile of a parameter is the lowest cost that the others can reach while it is held. Its 95 % interval is where

    (cost held - cost) / s² ≤ 1.96² κ,   κ = sd² / (s² [H⁻¹]ᵢᵢ)

or the bound, where that comes first. κ carries over what the standard deviation allows for beside white noise, so that the
interval is value ± 1.96 sd where the cost is a parabola (Venzon and Moolgavkar 1988).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servobench.channels import Array
from servobench.estimators.covariance import inverse
from servobench.estimators.least_squares import Layout, Minimum, minimise, normal_equations
from servobench.measurement.dataset import Dataset
from servobench.models.base import Structure
from servobench.rounding import TWO_SIDED

_NEAR = 3.0  # standard deviations to a bound below which its interval is a profile's
_STEPS = 6
_SETTLED = 0.01  # of the wished rise of the cost


def intervals_near_bounds(
    structure: Structure, data: Sequence[Dataset], minimum: Minimum, covariance: Array
) -> dict[str, tuple[float, float]]:
    """Return the 95 % intervals of those shared parameters that are within 3 standard deviations of a bound, by name.

    `covariance` (P, P) is that of the shared parameters; parameters of which the data say nothing are left out.
    """
    lower, upper = structure.bounds(data)
    found = {}
    for n, parameter in enumerate(structure.parameters):
        sd, value = float(np.sqrt(covariance[n, n])), float(minimum.theta[n])
        if not (0 < sd < np.inf) or min(value - lower[n], upper[n] - value) > _NEAR * sd:
            continue
        profile = _Profile(structure, tuple(data), minimum, n, sd)
        found[parameter.name] = (profile.end(-1.0, float(lower[n])), profile.end(1.0, float(upper[n])))
    return found


@dataclass(frozen=True, eq=False)
class _Profile:
    """The cost along one parameter, number `at` of the joint vector, beside a minimum."""

    structure: Structure
    data: tuple[Dataset, ...]
    minimum: Minimum
    at: int
    sd: float

    def end(self, side: float, bound: float) -> float:
        """The end of the interval on one side (±1): where the cost has risen by as much as it may, or the bound."""
        value = float(self.minimum.theta[self.at])
        far, rise_wished = side * TWO_SIDED * self.sd, self._rise()
        start = self.minimum.theta
        for _ in range(_STEPS):
            reach = min(abs(far), abs(bound - value)) * side
            held = self._held(start, value + reach)
            rise = held.cost - self.minimum.cost
            at_bound = abs(reach) < abs(far)
            if at_bound and rise <= rise_wished:
                return bound
            if abs(rise - rise_wished) <= _SETTLED * rise_wished or rise <= 0:
                return value + reach
            start = held.theta
            far = reach * float(np.clip(np.sqrt(rise_wished / rise), 0.3, 3.0))
        return value + far

    def _held(self, start: Array, value: float) -> Minimum:
        theta = start.copy()
        theta[self.at] = value
        free = np.ones(len(theta), dtype=bool)
        free[self.at] = False
        return minimise(self.structure, self.data, theta, free)

    def _rise(self) -> float:
        """1.96² κ s², which is what a parabola of that sd rises by over 1.96 sd."""
        h, _ = normal_equations(Layout(self.structure, self.data), self.minimum.predictions)
        own = float(inverse(h)[self.at, self.at])
        return TWO_SIDED**2 * self.sd**2 / own if own > 0 else np.inf

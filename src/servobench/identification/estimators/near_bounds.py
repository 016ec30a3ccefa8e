"""Intervals of parameters near a bound, by profile likelihood: there, value ± 1.96 sd would include impossible values.

The profile of a parameter is the lowest cost that the others can reach while it is fixed. Its 95 % interval is where

    (cost held - cost) / s² ≤ 1.96² κ,   κ = sd² / (s² [H⁻¹]ᵢᵢ)

or the bound, if that comes first. κ includes what the standard deviation allows for in addition to white noise, so that the
interval is value ± 1.96 sd if the cost is a parabola (Venzon and Moolgavkar 1988). A delay that is only known by a prior costs
(d - d₀)²/s² more in units of s², in H as in the cost; otherwise the other parameters could use any delay.

A search for the lowest cost may end in another, higher valley. So it begins at several points, and no interval ends where the
cost hasn't risen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import IntervalsOnDemand
from servobench.identification.estimators.covariance import inverse
from servobench.identification.estimators.delay_prior import DelayPrior
from servobench.identification.estimators.friction_across import FRICTION, nearest_corner
from servobench.identification.estimators.least_squares import (
    Layout,
    Minimum,
    Point,
    descent,
    information,
    square_jacobians,
)
from servobench.identification.models.base import Structure
from servobench.recordings.measurement.dataset import Dataset

_NEAR = 3.0  # standard deviations to a bound below which its interval is a profile's
_STEPS = 6
_SEARCH = 25  # steps with the parameter held: a valley that is followed from its slope is reached in a few
_SETTLED = 0.01  # of the wished rise of the cost
_WORTH = 0.1 * _SETTLED  # of it: a decrease that isn't worth another step
_FARTHER = 3.0  # times: the longest step outwards from where the cost hasn't risen enough


def intervals_near_bounds(
    structure: Structure,
    data: Sequence[Dataset],
    minimum: Minimum,
    covariance: Array,
    variance: float = 1.0,
    prior: DelayPrior | None = None,
) -> IntervalsOnDemand:
    """Return the 95 % intervals of those shared parameters that are within 3 standard deviations of a bound, by name.

    Each is searched for when it is read.

    An input under which the shaft rests counts as a bound of friction. `covariance` (P, P) is that of the shared parameters, with
    the `prior` of the delay in it where there is one, for which the `variance` of the residuals is needed; parameters of which
    the data say nothing are left out.
    """
    return IntervalsOnDemand(
        partial(searches_near_bounds, structure, tuple(data), minimum, covariance, variance, prior)
    )


def searches_near_bounds(
    structure: Structure,
    data: tuple[Dataset, ...],
    minimum: Minimum,
    covariance: Array,
    variance: float,
    prior: DelayPrior | None,
) -> dict[str, Callable[[], tuple[float, float]]]:
    """Return what finds the interval of each parameter near a bound, by name.

    The arguments are those of `intervals_near_bounds`, `covariance` (P, P) among them.
    """
    lower, upper = structure.bounds(data)
    searches: dict[str, Callable[[], tuple[float, float]]] = {}
    for n, parameter in enumerate(structure.parameters):
        sd, value = float(np.sqrt(covariance[n, n])), float(minimum.theta[n])
        corner = nearest_corner(data, value) if structure.friction and parameter.name == FRICTION else None
        corners = [bound for bound in (lower[n], upper[n], corner) if bound is not None]
        if 0 < sd < np.inf and min(abs(value - each) for each in corners) <= _NEAR * sd:
            profile = _Profile(structure, data, minimum, n, sd, variance, prior)
            searches[parameter.name] = partial(profile.interval, float(lower[n]), float(upper[n]))
    return searches


@dataclass(frozen=True, eq=False)
class _Profile:
    """The cost along one parameter, number `at` of the joint vector, beside a minimum."""

    structure: Structure
    data: tuple[Dataset, ...]
    minimum: Minimum
    at: int
    sd: float
    variance: float
    prior: DelayPrior | None

    def interval(self, lower: float, upper: float) -> tuple[float, float]:
        """The interval of a parameter with these bounds."""
        return self.end(-1.0, lower), self.end(1.0, upper)

    def end(self, side: float, bound: float) -> float:
        """The end of the interval on one side (±1): where the cost has risen by as much as it may, or the bound.

        Each trial lies within what is known to be inside and what is known to be outside.
        """
        value, wished = float(self.minimum.theta[self.at]), self._rise
        limit = abs(bound - value)
        inside, outside, reach = 0.0, np.inf, min(TWO_SIDED * self.sd, limit)
        start, lowest = self.minimum.theta, self.minimum.cost
        for _ in range(_STEPS):
            held = self._lowest_at(start, value + side * reach)
            rise = held.cost - lowest
            if rise <= wished:
                inside, start = reach, held.theta
                if reach >= limit:
                    return bound
            else:
                outside = reach
            if abs(rise - wished) <= _SETTLED * wished:
                break
            further = reach * float(np.clip(np.sqrt(wished / max(rise, 1e-9 * wished)), 0.3, _FARTHER))
            reach = min(further, limit)
            if not inside < reach < outside:
                reach = 0.5 * (inside + outside)
        return value + side * (reach if inside <= reach <= outside else inside)

    def _lowest_at(self, near: Array, value: float) -> Point:
        """The lowest cost with the parameter held: from where the minimum leads to, and from near by where that has risen."""
        free = np.arange(len(near)) != self.at
        led = self.minimum.theta.copy()
        led[free] += self._slope * (value - led[self.at])
        led[self.at] = value
        worth = _WORTH * self._rise
        bottom = descent(self._layout, led, free, _SEARCH, worth).point
        if bottom.cost <= self.minimum.cost + self._rise:
            return bottom
        beside = descent(self._layout, np.where(free, near, value), free, _SEARCH, worth).point
        return min(bottom, beside, key=lambda point: point.cost)

    @cached_property
    def _layout(self) -> Layout:
        """The cost, with what the prior adds to it."""
        if self.prior is None:
            return Layout(self.structure, self.data)
        middle = float(self.minimum.theta[self.prior.at])
        weight = self.variance / self.prior.scale**2
        return _WithDelayPrior(self.structure, self.data, self.prior.at, middle, weight)

    @cached_property
    def _information(self) -> Array:
        """J'J (P + ΣQ, P + ΣQ) at the minimum, with that of the prior."""
        layout = Layout(self.structure, self.data)
        h = information(layout, square_jacobians(layout, self.minimum.predictions))
        if self.prior is not None:
            h[self.prior.at, self.prior.at] += self.variance / self.prior.scale**2
        return h

    @cached_property
    def _slope(self) -> Array:
        """The change of the others with the parameter along the valley (P + ΣQ - 1,)."""
        free = np.arange(len(self.minimum.theta)) != self.at
        h = self._information
        return np.asarray(-inverse(h[np.ix_(free, free)]) @ h[free, self.at], dtype=np.float64)

    @cached_property
    def _rise(self) -> float:
        """1.96² κ s², which is what a parabola of that sd rises by over 1.96 sd."""
        own = float(inverse(self._information)[self.at, self.at])
        return TWO_SIDED**2 * self.sd**2 / own if own > 0 else np.inf


@dataclass(frozen=True, eq=False)
class _WithDelayPrior(Layout):
    """A sum of squares in which a delay, number `at`, costs the square of its distance from a `middle` [s], times a weight."""

    at: int
    middle: float
    weight: float

    def normal(self, theta: Array, record: Dataset) -> tuple[Array, Array, float]:
        """Return the sums of a record with its part of that cost."""
        h, g, cost = super().normal(theta, record)
        h, g = h.copy(), g.copy()
        weight, away = self.weight / len(self.data), float(theta[self.at]) - self.middle
        h[self.at, self.at] += weight
        g[self.at] -= weight * away
        return h, g, cost + weight * away**2

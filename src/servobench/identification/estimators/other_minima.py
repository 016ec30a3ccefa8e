"""Other minima that fit the data almost as well, as a line of the budget.

If a motor was running before its record began and follows a ramp, the data only determine the sum a τ + u_c of time constant
and friction: a small τ with a little friction, or a large one without, and the first samples absorb the rest. Each is a minimum
of its own, and the curvature at the lower one doesn't include the other. With normal residuals, minima whose sums of squares
over n samples are S₀ and S have the odds

    w = (S₀ / S)^(n/2)

and the variance of their mixture has Σ w δ δ' / Σ w more than that of one of them, δ the way from it to the others (model
averaging: Hoeting, Madigan, Raftery and Volinsky 1999). Of gain and time constant it is the way of their logarithms: where both
are many times larger at the other end of a valley, K/τ is what is known of them. Under one level u of the input K (u - u_c) is,
so u_c is moved by what leaves the speed's change as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.delay_prior import DelayPrior
from servobench.identification.estimators.least_squares import Minimum
from servobench.identification.models.level import OneLevel

SOURCE: Final = "another minimum"
_UNLIKELY = 1e-3  # as odds
_SAME = 1.0  # standard deviations: ends no farther than that from each other are one minimum


def other_minima(
    place: Minimum,
    others: Sequence[tuple[Array, float]],
    covariance: Array,
    samples: int,
    scales: Sequence[int] = (),
    prior: DelayPrior | None = None,
    one_level: OneLevel | None = None,
) -> Contribution | None:
    """Return the line for ends of a search (theta, cost) that explain n samples nearly as well as the place that is stated.

    `covariance` (P, P) is that at the place, `scales` are the indices of gain and time constant. With a `prior` of the delay each
    has the odds of its own delay, too; `one_level` is that of records without another one. None where there are no such ends, or
    the data don't leave anything over.
    """
    if not place.cost > 0:
        return None
    shared = len(covariance)
    sd = np.sqrt(np.diag(covariance))
    ways: list[Array] = []
    weights: list[float] = []
    for theta, cost in others:
        odds = _odds(place, theta, cost, samples, prior)
        way = _way(place.theta[:shared], theta[:shared], scales, one_level)
        if odds < _UNLIKELY or not all(_apart(way - other, sd) for other in (np.zeros(shared), *ways)):
            continue
        ways.append(way)
        weights.append(odds)
    if not ways:
        return None
    each = np.array(ways)
    added = (each.T * weights) @ each / (1.0 + sum(weights))
    reason = "a separate minimum explains the data nearly as well"
    return Contribution(source=SOURCE, covariance=added, reason=reason)


def _way(one: Array, other: Array, scales: Sequence[int], at: OneLevel | None) -> Array:
    """The way (P,) from one minimum to another, of those parameters by their logarithms as long as they keep their sign."""
    way = other - one
    for n in scales:
        if one[n] * other[n] > 0.0:
            way[n] = one[n] * np.log(other[n] / one[n])
    if at is not None and one[at.gain] != 0.0:
        faster = at.speed(other) - at.speed(one)
        way[at.friction] = ((at.level - one[at.friction]) * way[at.gain] - faster) / one[at.gain]
    return way


def _odds(place: Minimum, theta: Array, cost: float, samples: int, prior: DelayPrior | None) -> float:
    """The likelihood of an end relative to the place; at most 1, as the place was chosen."""
    exponent = samples * float(np.log(max(cost, 1e-300) / place.cost))
    if prior is not None:
        exponent += prior.penalty(float(theta[prior.at])) - prior.penalty(float(place.theta[prior.at]))
    return float(np.exp(-0.5 * max(exponent, 0.0)))


def _apart(way: Array, sd: Array) -> bool:
    """Whether two minima are not the same, as far as anything is known of where they are."""
    known = np.isfinite(sd) & (sd > 0)
    return bool(np.any(np.abs(way[known]) > _SAME * sd[known]))

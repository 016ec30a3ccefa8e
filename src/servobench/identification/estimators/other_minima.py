"""Other minima that the data allow nearly as well: as a line of the budget.

A motor that was running before its record began, and follows a ramp, shows time constant and friction by their sum a τ + u_c
only: a small τ with a little friction, or a large one without, with the first samples for the rest. Each is a minimum of its
own, and the curvature at the lower one knows nothing of the other. With normal residuals, minima whose sums of squares over n
samples are S₀ and S have the odds

    w = (S₀ / S)^(n/2)

and the variance of their mixture has Σ w δ δ' / Σ w more than that of one of them, δ the way from it to the others (model
averaging: Hoeting, Madigan, Raftery and Volinsky 1999).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.least_squares import Minimum

SOURCE: Final = "another minimum"
_UNLIKELY = 1e-3  # as odds
_SAME = 1.0  # standard deviations: ends no farther than that from each other are one minimum


def other_minima(minimum: Minimum, covariance: Array, samples: int) -> Contribution | None:
    """Return the line for the ends of a search that explain n samples nearly as well, `covariance` (P, P) that at the lowest.

    None where there are none, or the data don't leave anything over.
    """
    if not minimum.cost > 0:
        return None
    shared = len(covariance)
    sd = np.sqrt(np.diag(covariance))
    ways: list[Array] = []
    weights: list[float] = []
    for theta, cost in minimum.others:
        odds = float(np.exp(-0.5 * samples * np.log(cost / minimum.cost))) if cost > minimum.cost else 1.0
        way = (theta - minimum.theta)[:shared]
        if odds < _UNLIKELY or not all(_apart(way - other, sd) for other in (np.zeros(shared), *ways)):
            continue
        ways.append(way)
        weights.append(odds)
    if not ways:
        return None
    each = np.array(ways)
    added = (each.T * weights) @ each / (1.0 + sum(weights))
    reason = "other figures explain the data nearly as well, with none between them that do"
    return Contribution(source=SOURCE, covariance=added, reason=reason)


def _apart(way: Array, sd: Array) -> bool:
    """Whether two minima are not the same, as far as anything is known of where they are."""
    known = np.isfinite(sd) & (sd > 0)
    return bool(np.any(np.abs(way[known]) > _SAME * sd[known]))

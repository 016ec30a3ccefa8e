"""Motors that are unlike the others: distances that a few odd motors can't hide from."""

from __future__ import annotations

from functools import cache

import numpy as np

from servobench.core.channels import Array

_MAD = 1.482602218505602  # standard deviations of a normal distribution in a median absolute deviation
_ONE_IN = 100  # fleets without an odd motor that show one
_NEAR = 0.9  # of the motors, from which the second estimate is made
_MANY = 300  # motors, of which the estimate is nearly that of infinitely many
_FLEETS = 1000
_FOR_EACH = 10  # motors for each parameter, of which a covariance can be estimated
_FEWEST = 8  # motors; of fewer nothing can be said


def distances(x: Array, u: Array) -> Array:
    """Return how far each motor is from the middle of all, in standard deviations: a Mahalanobis distance (N,).

    `x` are parameters (N, p), `u` their standard uncertainties (N, p); a row with NaN has the distance NaN, and so has every row
    where there are fewer than 8 without, or no scatter. Middle and covariance are the orthogonalised Gnanadesikan-Kettenring
    estimate with median and MAD, reweighted once, which bears up to half of the motors being odd and needs no random numbers. A
    motor that is known less well than half of the others may be further away by that. Source: R. A. Maronna, R. H. Zamar,
    Technometrics 44 (2002) 307. Of fewer than ten motors for each parameter no covariance can be estimated: the distance is then
    that of the parameter which is furthest from its median.
    """
    distance = np.full(len(x), np.nan)
    whole = np.isfinite(x).all(axis=1)
    if whole.sum() < _FEWEST:
        return distance
    x, u = x[whole], u[whole]
    scale = _scale(x)
    used = scale > 0
    if not used.any():
        return distance
    x, u = x[:, used] / scale[used], u[:, used] / scale[used]
    beyond = np.maximum(u**2 - np.median(u**2, axis=0), 0.0)
    if len(x) < _FOR_EACH * x.shape[1]:
        distance[whole] = (np.abs(x - np.median(x, axis=0)) / np.sqrt(1.0 + beyond)).max(axis=1)
        return distance
    middle, covariance = _reweight(x, *_ogk(x))
    each = covariance + beyond[:, :, None] * np.eye(x.shape[1])
    offset = x - middle
    distance[whole] = np.sqrt(
        np.einsum("ni,ni->n", offset, np.linalg.solve(each, offset[:, :, None])[:, :, 0])
    )
    return distance


@cache
def farthest_plain(count: int, parameters: int) -> float:
    """Return the distance that of `count` motors without an odd one the farthest exceeds in one fleet of a hundred.

    For normal parameters: above 300 motors the root of the χ² quantile at 1 - 0.01/count; for fewer, whose covariance is itself
    hardly known, the 99 % quantile of the farthest of 1000 simulated fleets, always the same ones.
    """
    from scipy.stats import chi2

    count, parameters = max(count, 1), max(parameters, 1)
    if count > _MANY or count < _FEWEST:
        return float(np.sqrt(chi2.isf(1 / _ONE_IN / count, parameters)))
    random = np.random.default_rng(count)
    none = np.zeros((count, parameters))
    farthest = [distances(random.normal(size=none.shape), none).max() for _ in range(_FLEETS)]
    return float(np.quantile(farthest, 1 - 1 / _ONE_IN))


def _ogk(x: Array) -> tuple[Array, Array]:
    """Middle (p,) and covariance (p, p) of scaled parameters (N, p)."""
    p = x.shape[1]
    together = np.eye(p)
    for j in range(p):
        for k in range(j):
            wide, narrow = _scale(np.column_stack([x[:, j] + x[:, k], x[:, j] - x[:, k]]))
            together[j, k] = together[k, j] = (wide**2 - narrow**2) / 4
    _, directions = np.linalg.eigh(together)
    along = x @ directions
    scale = np.maximum(
        _scale(along), 1e-4
    )  # parameters that are one and the same leave a direction without scatter
    middle: Array = directions @ np.median(along, axis=0)
    covariance: Array = (directions * scale**2) @ directions.T
    return middle, covariance


def _reweight(x: Array, middle: Array, covariance: Array) -> tuple[Array, Array]:
    """Middle and covariance of the nearest nine tenths by a first estimate, scaled so that the median of d² is that of χ²."""
    from scipy.stats import chi2

    p = x.shape[1]
    d2 = _squares(x - middle, covariance)
    near = x[d2 <= chi2.ppf(_NEAR, p) * np.median(d2) / chi2.ppf(0.5, p)]
    middle, covariance = near.mean(axis=0), np.cov(near, rowvar=False).reshape(p, p)
    covariance = covariance + 1e-8 * np.eye(p)  # as above, of parameters that are one and the same
    return middle, covariance * float(np.median(_squares(x - middle, covariance)) / chi2.ppf(0.5, p))


def _squares(offset: Array, covariance: Array) -> Array:
    squares: Array = np.einsum("ni,ni->n", offset, np.linalg.solve(covariance, offset.T).T)
    return squares


def _scale(x: Array) -> Array:
    """The robust standard deviation of each column."""
    scale: Array = _MAD * np.median(np.abs(x - np.median(x, axis=0)), axis=0)
    return scale

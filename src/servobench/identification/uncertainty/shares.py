"""How much there is of something that a motor may have, between none of it and all, by what the data say of it.

The data say that the part φ is normal, with a mean and a standard deviation s. Beforehand it is zero, or else, with some chance,
anything between 0 and 1. What is off by φ b has the covariance b b' E[φ²].
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array

_NODES = np.linspace(0.0, 1.0, 201)
_FAR = 8.0  # standard deviations beyond which nothing is likely
_DRAWS = 15  # of a normal number, enough for a mean to three digits


def squared_share(mean: float, sd: float, chance: float = 1.0) -> float:
    """Return E[φ²] of a part φ of which the data say `mean` ± `sd`, and which there is at all with a `chance`, 0 to 1."""
    likeliest = float(np.clip(mean, 0.0, 1.0))
    low, high = np.clip([likeliest - _FAR * sd, likeliest + _FAR * sd], 0.0, 1.0)
    parts = low + (high - low) * _NODES
    best = ((likeliest - mean) / sd) ** 2
    likely: Array = chance * (high - low) / len(parts) * np.exp(0.5 * (best - ((parts - mean) / sd) ** 2))
    none = (1.0 - chance) * float(np.exp(0.5 * (best - (mean / sd) ** 2)))
    return float(np.sum(likely * parts**2) / (none + np.sum(likely)))


def expected_share(sd: float, chance: float = 1.0) -> float:
    """Return the mean of E[φ²] over what data with a standard deviation `sd` will say of a motor that has none of it."""
    draws, weights = np.polynomial.hermite_e.hermegauss(_DRAWS)
    shares = [squared_share(sd * float(draw), sd, chance) for draw in draws]
    return float(weights @ np.array(shares) / weights.sum())

"""How far friction may be from where it is estimated takes gain, time constant and delay along.

Coulomb friction near its bound, none, has an interval of its own, from a profile of the likelihood (Venzon and Moolgavkar 1988):
a shaft that friction holds and one that it doesn't differ by more than a slope tells. The covariance knows the slope alone, and a
friction that rests at its bound is held there for the others' sake. So the friction u is set to the far end of its interval, U,
and the others are searched for. Where one goes twice as far as its own interval reaches, the intervals are stretched to hold it,
and the budget has

    C = δ δ' / 1.96²,   δ = 64 (θ(u + (U - u)/64) - θ(u)),

whose direction is that of the first step on the way: gain and friction have a product in common, which is known as before.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.friction_across import FRICTION
from servobench.identification.estimators.least_squares import NormalEquations, lowest
from servobench.identification.estimators.prediction_error import maximum_likelihood

SOURCE: Final = "friction not known"
_NEAR: Final = 1 / 64  # of the way to the far end
_KNOWN: Final = 0.5  # of its value: a gain known to no better isn't stated by itself
_CLEARLY: Final = 2.0  # times their intervals: what is straight stays within them


def with_friction_range(fit: Fit) -> Fit:
    """Return the fit with a line of its budget where the far end of the friction's interval moves the others out of theirs."""
    if not _is_open(fit):
        return fit
    at, sd = fit.model.names.index(FRICTION), np.sqrt(np.diag(fit.covariance))
    interval = fit.intervals[FRICTION]
    reach = interval[1] - fit.model[FRICTION]
    here, there = (_others_at(fit, at, fit.model[FRICTION] + each) for each in (0.0, reach))
    if not np.any(np.delete(np.abs(there - here) > _CLEARLY * TWO_SIDED * sd, at)):
        return fit
    way = (_others_at(fit, at, fit.model[FRICTION] + _NEAR * reach) - here) / _NEAR
    line = Contribution(
        source=SOURCE,
        covariance=np.outer(way, way) / TWO_SIDED**2,
        reason="more friction explains the data equally well, with other values of the rest",
    )
    wider = fit.widen(line)
    far = fit.model.theta + there - here
    holding = {
        name: _interval_with(wider[name].interval, float(far[n])) for n, name in enumerate(fit.model.names)
    }
    return replace(wider, intervals={**holding, FRICTION: interval})


def _is_open(fit: Fit) -> bool:
    """Whether a gain is known by itself, beside a friction that may be larger by more than its standard deviation says."""
    names = fit.model.names
    if (
        not isinstance(fit.model.structure, NormalEquations)
        or "gain" not in names
        or FRICTION not in fit.intervals
    ):
        return False
    if not TWO_SIDED * fit.sd("gain") < _KNOWN * abs(fit.model["gain"]):
        return False
    return fit.intervals[FRICTION][1] - fit.model[FRICTION] > TWO_SIDED * fit.sd(FRICTION)


def _others_at(fit: Fit, at: int, friction: float) -> Array:
    """The shared parameters (P,) that explain the data best with this friction."""
    start, free = fit.vector.copy(), np.arange(len(fit.vector)) != at
    start[at] = friction
    if fit.disturbance is not None:
        return maximum_likelihood(fit, fit.disturbance, start, free)[: len(fit.model.theta)]
    minimum = lowest(fit.model.structure, [record.data for record in fit.records], (start,), free)
    return minimum.theta[: len(fit.model.theta)]


def _interval_with(interval: tuple[float, float], value: float) -> tuple[float, float]:
    return min(interval[0], value), max(interval[1], value)

"""A random torque that may act on a motor although the data don't show it, as a line of the budget.

Rounding averages out so well that an interval may be far smaller than a count, and smaller than the effect of a torque that
changes no count. This matters most for the offset voltage, which the mean of a random torque looks like. If no test finds a
torque, there may still be one. So each level has a probability: before the data, one half for none and one half spread evenly
over the logarithm of the levels at which motors wander; after the data, this times the likelihood L. The mixture of the levels
adds to the covariance

    Σ w (C - C₀) + Σ w δ δ',   w ∝ prior · L

where C is the covariance at a level and C₀ without a torque, δ the change of the estimates (model averaging: Hoeting, Madigan,
Raftery and Volinsky 1999).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution, beyond
from servobench.identification.estimators.disturbance import Disturbance, Trial
from servobench.identification.estimators.misfit_covariance import SOURCE as NOISE_MODEL
from servobench.identification.estimators.prediction_error import PredictionError, linearise
from servobench.identification.estimators.sizes import WEAK, sizes

SOURCE: Final = "random torque not seen"
# By what part of the largest speed that its input can ask of it a motor wanders: below, nothing shows; above, it is seen.
_LEVELS = np.geomspace(1e-4, 3e-2, 9)


def with_unseen_torque(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for a random torque that the data don't show but don't exclude, either.

    The same where the noise model has a torque already, what comes of one is in the budget, or one can't be tried.
    """
    data = [record.data for record in fit.records]
    structure = fit.model.structure
    tried = fit.disturbance is not None or any(line.source == NOISE_MODEL for line in fit.budget)
    first_order = {"gain", "time_constant"} <= set(fit.model.names)
    if tried or not first_order or PredictionError().supports(structure, data) is not None:
        return fit
    covariance = beyond(fit.covariance + _extra_covariance(fit), fit.covariance)
    reason = "a random torque too small to be seen shifts the parameters by more than encoder rounding does"
    return fit.widen(Contribution(source=SOURCE, covariance=covariance, reason=reason))


def _extra_covariance(fit: Fit) -> Array:
    """What the mixture has more than the covariance without a torque (P, P)."""
    data = [record.data for record in fit.records]
    structure, tau, shared = fit.model.structure, fit.model["time_constant"], len(fit.model.theta)
    speed = abs(fit.model["gain"]) * max(float(np.abs(record.u).max(initial=0.0)) for record in data)
    q = 2.0 * (_LEVELS * speed) ** 2 / tau  # the speed wanders by √(q τ / 2)
    r = linearise(structure, data, fit.vector, None).under(tau, 0.0).variance
    finest = Disturbance(tau=tau, ratio=float(q[-1] / r), variance=r)
    near = replace(linearise(structure, data, fit.vector, finest), prior=r / (WEAK * sizes(fit)) ** 2)
    none = near.under(tau, 0.0)
    ratios = q / none.variance
    trials = [none, *(near.under(tau, float(ratio)) for ratio in ratios)]
    weights = _weights(trials)
    out = np.zeros((shared, shared))
    for weight, trial in zip(weights, trials, strict=True):
        apart = (trial.change - none.change)[:shared]
        out += weight * ((trial.covariance - none.covariance)[:shared, :shared] + np.outer(apart, apart))
    return out


def _weights(trials: list[Trial]) -> Array:
    """How probable each trial is, the first of them being that without a torque."""
    deviances = np.array([trial.deviance for trial in trials])
    prior = np.append(1.0, np.full(len(trials) - 1, 1.0 / (len(trials) - 1)))
    weights = prior * np.exp(-0.5 * (deviances - deviances.min()))
    return np.asarray(weights / weights.sum(), dtype=np.float64)

"""A random torque that may act on a motor although the data don't show it, as a line of the budget.

Rounding averages out so well that an interval may be far smaller than a count, and smaller than the effect of a torque that
changes no count. This matters most for the offset voltage, which the mean of a random torque looks like. If no test finds a
torque, there may still be one. So each level has a probability: before the data, one half for none and one half spread evenly
over the logarithm of the levels at which motors wander; after the data, this times the likelihood L. The mixture of the levels
adds to the covariance

    Σ w (C - C₀) + Σ w δ δ',   w ∝ prior · L

where C is the covariance at a level and C₀ without a torque, δ the change of the estimates (model averaging: Hoeting, Madigan,
Raftery and Volinsky 1999). Such a mixture isn't normal: where a torque acts with a chance of one in ten only, an error of
four of its standard deviations happens once in a hundred recordings. So each parameter has the standard deviation of a normal
distribution that reaches as far as the mixture once in a hundred, where that is more.

L takes rounding for white noise, and it isn't: it wanders slowly where a shaft turns slowly, which looks like a torque. Where all
counts are where the model puts them, that is all that is known of the motion between them, and white noise of the same size
stands for it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.budget import Contribution, beyond
from servobench.identification.estimators.disturbance import Disturbance, Trial
from servobench.identification.estimators.misfit_covariance import SOURCE as NOISE_MODEL
from servobench.identification.estimators.prediction_error import (
    PredictionError,
    linearise,
    rounding_explains,
)
from servobench.identification.estimators.sizes import WEAK, sizes
from servobench.recordings.measurement.dataset import Dataset

SOURCE: Final = "random torque not seen"
# By what part of the largest speed that its input can ask of it a motor wanders: below, nothing shows; above, it is seen.
_LEVELS = np.geomspace(1e-4, 3e-2, 9)
_SELDOM, _NORMAL = 0.01, 2.5758  # a chance, and how many standard deviations off a normal number is with it
_POINT = 1e-12  # of the whole variance


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
    """The additional covariance of the mixture over that without a torque (P, P)."""
    data = _with_white_rounding(fit)
    structure, tau, shared = fit.model.structure, fit.model["time_constant"], len(fit.model.theta)
    speed = abs(fit.model["gain"]) * max(float(np.abs(record.u).max(initial=0.0)) for record in data)
    q = 2.0 * (_LEVELS * speed) ** 2 / tau  # the speed wanders by √(q τ / 2)
    r = linearise(structure, data, fit.vector, None).under(tau, 0.0).variance
    finest = Disturbance(tau=tau, ratio=float(q[-1] / r), variance=r)
    near = replace(linearise(structure, data, fit.vector, finest), prior=r / (WEAK * sizes(fit)) ** 2)
    none = near.under(tau, 0.0)
    trials = [none, *near.under_each(tau, q / none.variance)]
    weights = _weights(trials)
    apart = np.array([(trial.change - none.change)[:shared] for trial in trials])
    each = np.array([trial.covariance[:shared, :shared] for trial in trials])
    mixed = np.einsum("k,kij->ij", weights, each) + (apart.T * weights) @ apart
    variances = np.diagonal(each, axis1=1, axis2=2)
    times = [tail_factor(weights, apart[:, n], variances[:, n], float(mixed[n, n])) for n in range(shared)]
    return np.asarray(np.outer(times, times) * mixed - each[0], dtype=np.float64)


def _with_white_rounding(fit: Fit) -> list[Dataset]:
    """The records, with noise of the size of rounding in place of the rounding where that is all that a fit leaves over."""
    if not rounding_explains(fit):
        return [record.data for record in fit.records]
    random = np.random.default_rng(0)
    return [_dither(record, random) for record in fit.records]


def _dither(record: FittedRecord, random: np.random.Generator) -> Dataset:
    """A record (N,) as if its counts had been rounded at random; one that is in the wrong place stays as far off."""
    half = 0.5 * (record.data.quantum or 0.0)
    noise = random.uniform(-half, half, len(record.residual))
    off = record.residual - np.clip(record.residual, -half, half)
    return replace(record.data, y=record.prediction + noise + off)


def tail_factor(weights: Array, means: Array, variances: Array, variance: float) -> float:
    """Return by how much wider a normal distribution has to be to reach as far as a mixture of others (K,) once in a hundred.

    `variance` is the mean square of the whole mixture about zero; the factor is at least 1.
    """
    from servobench.identification.estimators import kernels

    if not variance > 0:
        return 1.0
    # In standard deviations of the whole; a parameter that one level holds at its place is a point there.
    middles, sds = means / np.sqrt(variance), np.sqrt(np.maximum(variances / variance, _POINT))
    return max(kernels.mixture_reach(weights, middles, sds, _SELDOM) / _NORMAL, 1.0)


def _weights(trials: list[Trial]) -> Array:
    """The probability of each trial; the first is without a torque."""
    deviances = np.array([trial.deviance for trial in trials])
    prior = np.append(1.0, np.full(len(trials) - 1, 1.0 / (len(trials) - 1)))
    weights = prior * np.exp(-0.5 * (deviances - deviances.min()))
    return np.asarray(weights / weights.sum(), dtype=np.float64)

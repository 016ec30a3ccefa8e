"""The choice between two fits: by Schwarz's criterion, by the change of the parameters, by the likelihood of the innovations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.errors import NotIdentifiable
from servobench.identification.estimators import delay_prior
from servobench.identification.estimators.base import Estimator, Fit
from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.estimators.disturbance import innovation_sd
from servobench.identification.estimators.least_squares import Minimum
from servobench.identification.models.base import Structure
from servobench.recordings.measurement.dataset import Dataset


def fit_structure(method: Estimator, structure: Structure, data: Sequence[Dataset]) -> Fit:
    """Return the fit; raises `NotIdentifiable` with the estimator's reason why it can't be done."""
    hindrance = method.supports(structure, data)
    if hindrance is not None:
        raise NotIdentifiable(hindrance.sentence.rstrip("."))
    return method.fit(structure, data)


def better(one: Fit, other: Fit) -> bool:
    """Return whether a fit with one parameter more is worth it by Schwarz's criterion (1978), its delay being as likely.

    An unexpected delay counts against a fit, because it may replace a missing parameter: on a ramp from rest
    for the friction that the input has to overcome.
    """
    samples = sum(int(record.valid.sum()) for record in one.records)
    return bool(_gain(one, other, samples) > np.log(samples))


def _gain(one: Fit, other: Fit, worth: float) -> float:
    """The excess of twice the logarithm of one fit's posterior over another's, but for the number of parameters.

    `worth` is how many samples of white noise the residuals are worth.
    """
    better_fit = worth * float(np.log(other.residual_sd**2 / one.residual_sd**2))
    return better_fit + delay_prior.surprise(other) - delay_prior.surprise(one)


def clearly_better(one: Fit, other: Fit) -> bool:
    """Return the same where residuals of a colour count for as many samples as `effective_samples` leaves of them."""
    worth = sum(effective_samples(record.residual[record.valid]) for record in one.records)
    samples = sum(int(record.valid.sum()) for record in one.records)
    return bool(_gain(one, other, worth) > np.log(samples))


def shifts_parameters(one: Fit, other: Fit) -> bool:
    """Return whether the other fit's gain or time constant is out by more than its own standard deviation if the one is right.

    Then the intervals without the parameter would be too narrow.
    """
    return any(abs(one.model[n] - other.model[n]) > other.sd(n) for n in ("gain", "time_constant"))


def worth_it(richer: Minimum, data: Sequence[Dataset], plain: Fit, among: int) -> bool:
    """Return whether a rung explains more than chance, with as many samples as `effective_samples` leaves.

    By Schwarz's criterion (1978) with 2 ln(among) on top, as it is the best of so many that compete (Chen and Chen 2008, eq. 1,
    for γ = 1): of several that explain nothing one looks worth its parameter by chance, on a short record above all.
    """
    more = len(richer.theta) - len(plain.vector)
    before = sum(float(np.sum(record.residual[record.valid] ** 2)) for record in plain.records)
    worth = 0.0
    for record, prediction in zip(data, richer.predictions, strict=True):
        worth += effective_samples((record.y - prediction.y)[prediction.valid])
    samples = sum(int(prediction.valid.sum()) for prediction in richer.predictions)
    needed = max(more, 1) * float(np.log(samples)) + 2 * float(np.log(among))
    return worth * float(np.log(before / richer.cost)) > needed


def schwarz_criterion(fit: Fit) -> float:
    """Return Schwarz's criterion (1978) of a fit's innovations, but for a constant: the lower, the likelier."""
    samples = sum(int(record.valid.sum()) for record in fit.records)
    return deviance(fit) + len(fit.vector) * float(np.log(samples))


def deviance(fit: Fit) -> float:
    """Return -2 ln of the likelihood of a fit's innovations, but for a constant: Σ e²/s² + 2 ln s over the samples."""
    total = 0.0
    for record in fit.records:
        spread = np.full(len(record.residual), fit.residual_sd)
        if fit.disturbance is not None:
            theta = np.concatenate([fit.model.theta, record.nuisance])
            spread = innovation_sd(
                record.data, fit.model.structure.sliding(theta, record.data), fit.disturbance
            )
        total += float(np.sum((record.innovations**2 + 2 * np.log(spread))[record.valid]))
    return total

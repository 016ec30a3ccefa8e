"""Which of two fits is worth its parameters: by Schwarz's criterion, by what it moves, by the likelihood of its innovations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.errors import NotIdentifiable
from servobench.estimators.base import Estimator, Fit
from servobench.estimators.covariance import andrews_lag, long_run
from servobench.estimators.disturbance import innovation_sd
from servobench.estimators.least_squares import Minimum
from servobench.measurement.dataset import Dataset
from servobench.models.base import Structure


def fitted(method: Estimator, structure: Structure, data: Sequence[Dataset]) -> Fit:
    """Return the fit; raises `NotIdentifiable` with the estimator's reason why it can't be done."""
    hindrance = method.supports(structure, data)
    if hindrance is not None:
        raise NotIdentifiable(hindrance.sentence.rstrip("."))
    return method.fit(structure, data)


def better(one: Fit, other: Fit) -> bool:
    """Return whether a fit with one parameter more is worth it by Schwarz's criterion (1978)."""
    samples = sum(int(record.valid.sum()) for record in one.records)
    return bool(samples * np.log(other.residual_sd**2 / one.residual_sd**2) > np.log(samples))


def moved(one: Fit, other: Fit) -> bool:
    """Return whether the other fit's gain or time constant is out by more than its own standard deviation if the one is right.

    Then leaving a parameter out would claim to know more than the data tell.
    """
    return any(abs(one[n].value - other[n].value) > other[n].sd for n in ("gain", "time_constant"))


def worth_it(richer: Minimum, data: Sequence[Dataset], plain: Fit) -> bool:
    """Return whether a rung explains more by Schwarz's criterion (1978), with as many samples as the residual's colour leaves.

    Of n samples whose mean varies as that of n/κ white ones, n/κ count: κ is the long-run variance over the variance.
    """
    more = len(richer.theta) - len(plain.vector)
    before = sum(float(np.sum(record.residual[record.valid] ** 2)) for record in plain.records)
    worth = 0.0
    for record, prediction in zip(data, richer.predictions, strict=True):
        residual = (record.y - prediction.y)[prediction.valid][:, None]
        power = float(np.sum(residual**2))
        colour = float(long_run(residual, andrews_lag(residual))[0, 0]) / power if power > 0 else 1.0
        worth += len(residual) / max(colour, 1.0)
    samples = sum(int(prediction.valid.sum()) for prediction in richer.predictions)
    return worth * float(np.log(before / richer.cost)) > max(more, 1) * float(np.log(samples))


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

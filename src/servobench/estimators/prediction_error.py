"""Prediction error: a random torque may act on the motor, and each sample is predicted from those before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.channels import Array
from servobench.errors import NotIdentifiable
from servobench.estimators.base import ESTIMATORS, Abilities, Fit, FittedRecord, hindrance
from servobench.estimators.disturbance import Profile, Whitened, profile, whitened
from servobench.estimators.least_squares import Layout, minimise
from servobench.estimators.output_error import OutputError, remarks, simulations, uncertainty
from servobench.finding import Finding, info, refusal
from servobench.measurement.dataset import Dataset
from servobench.models.base import Structure

THRESHOLD = 2.71  # the likelihood ratio that 5 % of the records without a disturbance exceed
_ROUNDS = 4
_SETTLED = 0.02  # of a standard deviation


class PredictionError:
    """Minimises the innovations of a Kalman filter for random torque and measurement noise, their levels profiled.

    Maximum likelihood for white torque: where output error takes the wandering of the position for the motor's own motion, this
    doesn't. In turns, the filter is fixed by the residuals' likelihood (q/r, r, at the present τ) and the parameters are
    found by least squares on the innovations (Ljung 1999, chapter 7).
    """

    abilities = Abilities(
        method="predicts each sample from those before it with a Kalman filter, and minimises the innovations",
        noise="a random torque on the motor, and white noise of the measurement; both levels are found",
        interval="covers under a random torque",
        position=True,
        speed=True,
        chain=False,
        irregular_times=True,
        several_records=True,
        closed_loop=True,
        delay=True,
        friction=True,
        disturbance=True,
    )

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return a refusal for data behind a measurement chain, or a structure whose speed has no time constant."""
        names = {parameter.name for parameter in structure.parameters}
        if "time_constant" not in names:
            return refusal("estimator-unsuited", "prediction_error needs a structure with a time constant.")
        return hindrance("prediction_error", self.abilities, structure, data)

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the fit, from where output error ends or from start vectors; raises `NotIdentifiable`."""
        lacking = self.supports(structure, data)
        if lacking is not None:
            raise NotIdentifiable(lacking.sentence.rstrip("."))
        start = OutputError().fit(structure, data, starts)
        return self.fit_after(start)

    def fit_after(self, start: Fit) -> Fit:
        """Return the fit that begins from another estimator's."""
        structure, data = start.model.structure, tuple(record.data for record in start.records)
        theta = np.concatenate([start.model.theta, *(record.nuisance for record in start.records)])
        for _ in range(_ROUNDS):
            before, found = theta, _profiled(structure, data, theta)
            model = Whitened(structure, found.disturbance, data, _sliding(structure, data, theta))
            minimum = minimise(model, model.whitened_data, theta)
            theta = minimum.theta
            _, covariance = uncertainty(model, model.whitened_data, minimum)
            change = (theta - before)[: len(covariance)]
            if np.all(np.abs(change) <= _SETTLED * np.sqrt(np.diag(covariance))):
                break
        return replace(
            start,
            model=replace(start.model, theta=theta[: len(covariance)]),
            covariance=covariance,
            estimator="prediction_error",
            converged=minimum.converged,
            status=minimum.status,
            residual_sd=float(np.sqrt(found.disturbance.variance)),
            disturbance=found.disturbance,
            records=_with_innovations(simulations(structure, data, theta), model),
            findings=(*remarks(structure, data, minimum), _told(found, data[0])),
        )


ESTIMATORS.member("prediction_error")(PredictionError())


def disturbance_test(fit: Fit) -> Profile | None:
    """Return the most likely disturbance behind a fit's residuals and its likelihood ratio; None where it can't be tested.

    The ratio is evaluated without a new fit of the parameters, so it is a lower bound.
    """
    data = [record.data for record in fit.records]
    if PredictionError().supports(fit.model.structure, data) is not None:
        return None
    theta = np.concatenate([fit.model.theta, *(record.nuisance for record in fit.records)])
    return _profiled(fit.model.structure, data, theta)


def _profiled(structure: Structure, data: Sequence[Dataset], theta: Array) -> Profile:
    tau = float(theta[[parameter.name for parameter in structure.parameters].index("time_constant")])
    residuals = [record.residual for record in simulations(structure, data, theta)]
    return profile(residuals, data, _sliding(structure, data, theta), tau)


def _sliding(structure: Structure, data: Sequence[Dataset], theta: Array) -> tuple[Array, ...]:
    places = Layout(structure, tuple(data)).columns()
    return tuple(structure.sliding(theta[place], record) for record, place in zip(data, places, strict=True))


def _with_innovations(records: Sequence[FittedRecord], model: Whitened) -> tuple[FittedRecord, ...]:
    """The records with their residuals as innovations of the noise model."""
    return tuple(
        replace(record, innovations=whitened(record.residual, record.data, sliding, model.disturbance))
        for record, sliding in zip(records, model.moving, strict=True)
    )


def _told(found: Profile, data: Dataset) -> Finding:
    wander = f"{found.disturbance.wander:.2g} {data.position_unit}/s"
    return info(
        "disturbance-found",
        f"Something moves the motor at random: its speed wanders by {wander} beside what the input does (likelihood ratio "
        f"{found.likelihood_ratio:.3g}; chance alone exceeds {THRESHOLD} once in twenty). The estimator prediction_error "
        "allows for it; the intervals of output_error would be too narrow.",
        parameters=("gain", "time_constant"),
    )

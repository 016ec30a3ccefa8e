"""Prediction error: a random torque may act on the motor, and each sample is predicted from those before it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, info, refusal
from servobench.core.rounding import plain as number
from servobench.identification.estimators.base import (
    ESTIMATORS,
    Abilities,
    Fit,
    FittedRecord,
    hindrance,
)
from servobench.identification.estimators.disturbance import (
    WEIGHED,
    Disturbance,
    Linearisation,
    Profile,
    WhitenedStructure,
    blocks_of,
    longest_block,
    of_each_sample,
    profile,
    variance_of_rest,
    whiten,
)
from servobench.identification.estimators.encoder_rounding import counts_in_place
from servobench.identification.estimators.least_squares import Layout, minimise
from servobench.identification.estimators.near_bounds import intervals_near_bounds
from servobench.identification.estimators.output_error import OutputError, remarks, simulations, uncertainty
from servobench.identification.models.base import Structure
from servobench.recordings.measurement.dataset import Dataset

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
        method="predicts each sample from the previous ones with a Kalman filter and minimises the innovations",
        noise="a random torque on the motor and white measurement noise; estimates both levels",
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

    def fit_after(self, start: Fit, test: Profile | None = None) -> Fit:
        """Return the fit that begins from another estimator's; `test` is that one's `disturbance_test`, if it exists already."""
        structure, data = start.model.structure, tuple(record.data for record in start.records)
        theta = start.vector
        likelihood = test or _profile(structure, data, theta)
        for remaining in reversed(range(_ROUNDS)):
            before = theta
            model = _structure_in_blocks(structure, likelihood.disturbance, data, theta)
            minimum = minimise(model, model.whitened_data, theta)
            theta = minimum.theta
            _, covariance = uncertainty(model, model.whitened_data, minimum)
            change = (theta - before)[: len(covariance)]
            if not remaining or np.all(np.abs(change) <= _SETTLED * np.sqrt(np.diag(covariance))):
                break
            likelihood = _profile(structure, data, theta, likelihood)
        covariance = likelihood.widen(covariance)
        records, disturbance = with_innovations(structure, data, theta, likelihood.disturbance)
        return replace(
            start,
            model=replace(start.model, theta=theta[: len(covariance)]),
            covariance=covariance,
            estimator="prediction_error",
            converged=minimum.converged,
            status=minimum.status,
            residual_sd=float(np.sqrt(disturbance.variance)),
            disturbance=disturbance,
            intervals=intervals_near_bounds(model, model.whitened_data, minimum, covariance),
            records=records,
            findings=(*remarks(structure, data, minimum), _finding(likelihood, data[0])),
            budget=(),  # that of the other estimator is of its covariance
        )


ESTIMATORS.member("prediction_error")(PredictionError())


def maximum_likelihood(
    start: Fit, noise: Disturbance, vector: Array | None = None, free: NDArray[np.bool_] | None = None
) -> Array:
    """Return the vector (P + ΣQ,) that is most likely under a noise model that is known, searched for from another fit's.

    The search may begin from another `vector` of that size; `free` says which entries may move (all).
    """
    data = tuple(record.data for record in start.records)
    model = _structure_in_blocks(start.model.structure, noise, data, start.vector)
    return minimise(model, model.whitened_data, start.vector if vector is None else vector, free).theta


def rounding_explains(fit: Fit, times: float = 2.0) -> bool:
    """Return whether the encoder's rounding is all that a fit leaves over; see `counts_in_place`."""
    data = [record.data for record in fit.records]
    return counts_in_place(data, [record.residual for record in fit.records], len(fit.vector), times)


def disturbance_test(fit: Fit) -> Profile | None:
    """Return the most likely disturbance behind a fit's residuals and its likelihood ratio; None where it can't be tested.

    The ratio is evaluated without a new fit of the parameters, so it is a lower bound.
    """
    data = [record.data for record in fit.records]
    if PredictionError().supports(fit.model.structure, data) is not None:
        return None
    return _profile(fit.model.structure, data, fit.vector)


def linearise(
    structure: Structure, data: Sequence[Dataset], theta: Array, noise: Disturbance | None
) -> Linearisation:
    """Return the records near theta (P + ΣQ,), in blocks short compared with τ and with a noise model's memory."""
    layout = Layout(structure, tuple(data))
    lower, upper = layout.bounds()
    tau = time_constant(structure, theta)
    blocks = tuple(
        blocks_of(
            record,
            structure.sliding(theta[place], record),
            longest_block(noise, tau, record),
            variance_of_rest(record, noise),
        )
        for record, place in _each_record(layout)
    )
    columns = [_columns(structure, record, theta[place]) for record, place in _each_record(layout)]
    return Linearisation(
        blocks=blocks,
        columns=tuple(b.means(x) for b, x in zip(blocks, columns, strict=True)),
        places=tuple(layout.columns()),
        free=(theta > lower) & (theta < upper),
        kind=data[0].kind,
        sample_time=max(record.sample_time for record in data),
    )


def time_constant(structure: Structure, theta: Array) -> float:
    """Return the time constant [s] in a vector (P + ΣQ,) of a structure that has one."""
    return float(theta[[parameter.name for parameter in structure.parameters].index("time_constant")])


def _profile(
    structure: Structure, data: Sequence[Dataset], theta: Array, earlier: Profile | None = None
) -> Profile:
    """The likelihood of disturbances near theta.

    Blocks short compared with τ may still be long compared with the filter's memory; then shorter ones are tried.
    """
    tau = time_constant(structure, theta)
    noise = earlier.disturbance if earlier else None
    around = float(np.log(noise.ratio)) if noise else None
    while True:
        near = linearise(structure, data, theta, noise)
        likelihood = profile(near, tau, around)
        longest = [longest_block(noise, tau, record) for record in data]
        finer = [longest_block(likelihood.disturbance, tau, record) for record in data]
        if all(
            new >= 0.7 * old or old < 2 * record.sample_time
            for new, old, record in zip(finer, longest, data, strict=True)
        ):
            return likelihood
        noise, around = likelihood.disturbance, None  # what long blocks can't tell apart, shorter ones may


def _structure_in_blocks(
    structure: Structure, noise: Disturbance, data: tuple[Dataset, ...], theta: Array
) -> WhitenedStructure:
    """The structure under a noise model, in blocks of samples so short near theta that it doesn't matter where they begin."""
    layout = Layout(structure, data)
    blocks = tuple(
        blocks_of(
            record,
            structure.sliding(theta[place], record),
            longest_block(noise, noise.tau, record, WEIGHED),
            variance_of_rest(record, noise),
        )
        for record, place in _each_record(layout)
    )
    return WhitenedStructure(structure, noise, data, blocks)


def _each_record(layout: Layout) -> list[tuple[Dataset, NDArray[np.int64]]]:
    """Each record with the places of its parameters in the joint vector."""
    return list(zip(layout.data, layout.columns(), strict=True))


def _columns(structure: Structure, data: Dataset, theta: Array) -> Array:
    """The residual and the Jacobian of a record side by side (M, 1 + P + Q)."""
    prediction = structure.predict(theta, data)
    return np.column_stack([data.y - prediction.y, prediction.jacobian])


def with_innovations(
    structure: Structure, data: Sequence[Dataset], theta: Array, disturbance: Disturbance
) -> tuple[tuple[FittedRecord, ...], Disturbance]:
    """Return the records simulated with theta (P + ΣQ,) and their innovations, and the disturbance with a sample's noise."""
    records = simulations(structure, data, theta)
    moving = [
        structure.sliding(np.concatenate([theta[: len(structure.parameters)], record.nuisance]), record.data)
        for record in records
    ]
    each = of_each_sample(disturbance, [record.residual for record in records], data, moving)
    return tuple(
        replace(record, innovations=whiten(record.residual, record.data, slides, each))
        for record, slides in zip(records, moving, strict=True)
    ), each


def _wander(likelihood: Profile) -> str:
    """The size of the speed's wander, with its interval where two digits show one."""
    value, low, high = (number(each, 2) for each in (likelihood.disturbance.wander, *likelihood.wander))
    return value if low == high else f"{value} ({low} to {high})"


def _finding(likelihood: Profile, data: Dataset) -> Finding:
    unit = f"{data.position_unit}/s"
    if likelihood.likelihood_ratio <= THRESHOLD:
        return info(
            "disturbance-not-found",
            "The data show no random torque: including one improves the fit no more than chance would, so output_error is "
            "enough.",
        )
    return info(
        "disturbance-found",
        f"The speed wanders by {_wander(likelihood)} {unit} around the model's, by more than chance explains: a random torque, "
        "or something that the model leaves out. The intervals allow for it (estimator prediction_error).",
        parameters=("gain", "time_constant"),
    )

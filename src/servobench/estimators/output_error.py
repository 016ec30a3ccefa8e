"""Output error: the model is simulated from the input alone, and what is left of the output is least squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array
from servobench.estimators.base import ESTIMATORS, Abilities, Fit, FittedRecord, hindrance, too_few
from servobench.estimators.covariance import conservative, inverse, sandwiched
from servobench.estimators.encoder_rounding import counts_in_place, is_rounded, rounding_sines
from servobench.estimators.least_squares import (
    Layout,
    Minimum,
    jacobian_and_residual,
    lowest,
    normal_equations,
)
from servobench.estimators.near_bounds import intervals_near_bounds
from servobench.estimators.repetition import folded, period, repeats
from servobench.finding import Finding, info, warning
from servobench.measurement.dataset import Dataset
from servobench.models.base import STRUCTURES, Model, Prediction, Structure


class OutputError:
    """Minimises Σ (y - ŷ(θ))², ŷ simulated from the input alone and carried through the measurement chain.

    Right for white measurement noise, such as an encoder's rounding; its standard deviations are the larger of the plain
    ones and of those that allow for coloured residuals. Records share the parameters; each has its own start state. The model
    of the noise is that of Ljung 1999, section 4.2.
    """

    abilities = Abilities(
        method="simulates the model from the input alone and minimises what is left of the output, chain and delay included",
        noise="white noise of the measurement, such as an encoder's rounding",
        interval="covers; allows for coloured residuals, a little narrow where a random torque acts",
        position=True,
        speed=True,
        chain=True,
        irregular_times=True,
        several_records=True,
        closed_loop=True,
        delay=True,
        friction=True,
        disturbance=False,
    )

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return None: any structure that predicts will do."""
        return hindrance("output_error", self.abilities, structure, data)

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the best fit found from the start vectors, or from the structure's guesses where there are none."""
        return fitted(structure, data, best_minimum(structure, data, starts or structure.guesses(data)))


ESTIMATORS.member("output_error")(OutputError())


def fitted(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> Fit:
    """Return the fit that a minimum of the squared residuals stands for."""
    fit = fitted_roughly(structure, data, minimum)
    return replace(fit, intervals=intervals_near_bounds(structure, data, minimum, fit.covariance))


def fitted_roughly(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> Fit:
    """Return the same fit without the intervals of parameters near a bound, each of which takes a dozen searches."""
    variance, covariance = uncertainty(structure, data, minimum)
    sd = float(np.sqrt(variance))
    records = simulations(structure, data, minimum.theta, minimum.predictions)
    return Fit(
        model=Model(structure=structure, theta=minimum.theta[: len(structure.parameters)], data=data[0]),
        covariance=covariance,
        estimator="output_error",
        structure=STRUCTURES.name_of(structure),
        converged=minimum.converged,
        status=minimum.status,
        residual_sd=sd,
        records=tuple(replace(record, innovations=record.residual / (sd or 1.0)) for record in records),
        findings=tuple(remarks(structure, data, minimum)),
    )


def simulations(
    structure: Structure,
    data: Sequence[Dataset],
    theta: Array,
    predictions: Sequence[Prediction] | None = None,
) -> tuple[FittedRecord, ...]:
    """Return each record simulated with its part of theta (P + ΣQ,); without a noise model its innovations are its residuals.

    `predictions` are those of the records with that vector, where somebody has made them already.
    """
    places = Layout(structure, tuple(data)).columns()
    shared = len(structure.parameters)
    if predictions is None:
        predictions = [structure.predict(theta[place], r) for r, place in zip(data, places, strict=True)]
    records = []
    for record, place, prediction in zip(data, places, predictions, strict=True):
        residual = record.y - prediction.y
        records.append(
            FittedRecord(
                data=record,
                nuisance=theta[place[shared:]],
                prediction=prediction.y,
                residual=residual,
                innovations=residual,
                valid=prediction.valid,
            )
        )
    return tuple(records)


def uncertainty(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> tuple[float, Array]:
    """Return the variance of the residuals and the covariance (P, P) of the shared parameters at a minimum.

    Raises `NotIdentifiable` where there are no more samples than unknowns.
    """
    layout = Layout(structure, tuple(data))
    h, _ = normal_equations(layout, minimum.predictions)
    used = sum(int(p.valid.sum()) for p in minimum.predictions)
    freedom = used - len(minimum.theta)
    if freedom <= 0:
        raise too_few(used, len(minimum.theta), data)
    variance = minimum.cost / freedom
    return variance, _covariance(layout, minimum, h, variance)[: layout.shared, : layout.shared]


def _covariance(layout: Layout, minimum: Minimum, h: Array, variance: float) -> Array:
    """The covariance of the joint vector.

    A parameter at a bound that is a limit of nature, such as no friction, is held there for the others' sake; its own standard
    deviation is that of a free one. A parameter that the data say nothing about has an infinite one.

    Nothing is held where a delay ends at its bound, which allows for columns out of step and is no place where motors are. As
    the truth lies within the bounds, the bound brings the estimate no farther from it, measured by H (a projection onto a convex
    set): the covariance of a free delay is enough, that of a held one would take the bound for the delay.
    """
    lower, upper = layout.bounds()
    held = ((minimum.theta <= lower) & (lower >= 0)) | (minimum.theta >= upper)
    bread = inverse(h * np.outer(~held, ~held))
    scores = _scores(layout, minimum)
    covariance = conservative(variance * bread, sandwiched(bread, scores))
    repeated = _folded(layout, minimum, scores)
    if repeated:
        covariance = conservative(covariance, sandwiched(bread, repeated))
    residuals = [r.y - p.y for r, p in zip(layout.data, minimum.predictions, strict=True)]
    alone = counts_in_place(layout.data, residuals, len(minimum.theta))
    rounded = _rounded(layout, minimum, variance, alone)
    if rounded.size:
        exact = bread @ rounded @ bread
        # Where the data say next to nothing of some direction, a product with its huge variance is rounding error.
        if (np.diag(exact) >= 0).all():
            covariance = exact if alone else conservative(covariance, exact)
    unmodelled = _unmodelled(layout, minimum)
    if unmodelled.size:
        shift = bread @ unmodelled
        covariance += shift @ shift.T
    if held.any():
        covariance[held, held] = variance * np.diag(inverse(h))[held]
    unknown = np.diag(h) == 0
    covariance[unknown, unknown] = np.inf
    return covariance


def best_minimum(
    structure: Structure,
    data: Sequence[Dataset],
    starts: Sequence[Array],
    free: NDArray[np.bool_] | None = None,
) -> Minimum:
    """Return the lowest of the minima that start vectors lead to; `free` (P + ΣQ,) says which entries may move (all)."""
    return lowest(structure, data, starts, free)


def simulated(structure: Structure, theta: Array, data: Dataset) -> FittedRecord:
    """Return a record simulated with parameters theta (P,) that are held; only its own start state is fitted."""
    starts = [np.concatenate([theta, guess[len(theta) :]]) for guess in structure.guesses([data])]
    free = np.arange(len(starts[0])) >= len(theta)
    minimum = best_minimum(structure, [data], starts, free)
    return simulations(structure, [data], minimum.theta)[0]


def _unmodelled(layout: Layout, minimum: Minimum) -> Array:
    """J' E over the joint vector (P + ΣQ, all errors), E what the structure knows that its prediction may be wrong by."""
    columns = []
    for record, prediction, place in zip(layout.data, minimum.predictions, layout.columns(), strict=True):
        errors = layout.structure.unmodelled(minimum.theta[place], record)
        block = np.zeros((len(minimum.theta), errors.shape[1]))
        if errors.size:
            block[place] = prediction.jacobian[prediction.valid].T @ errors[prediction.valid]
        columns.append(block)
    return np.hstack(columns)


def _scores(layout: Layout, minimum: Minimum) -> list[Array]:
    """J_k r_k of each record over the joint vector, shape (N, P + ΣQ)."""
    scores = []
    for record, prediction, place in zip(layout.data, minimum.predictions, layout.columns(), strict=True):
        j, r = jacobian_and_residual(record, prediction)
        s = j * r[:, None]
        if len(layout.data) > 1:
            s, own = np.zeros((len(r), len(minimum.theta))), s
            s[:, place] = own
        scores.append(s)
    return scores


def _folded(layout: Layout, minimum: Minimum, scores: Sequence[Array]) -> list[Array]:
    """The scores of all records, summed over the input's periods where the residual repeats; none where no record's does."""
    out, any_repeats = [], False
    for record, prediction, s in zip(layout.data, minimum.predictions, scores, strict=True):
        cycle = period(record) if len(s) == len(record.y) else None
        again = cycle is not None and repeats(record.y - prediction.y, cycle)
        any_repeats |= again
        out.append(folded(s, cycle) if again and cycle is not None else s)
    return out if any_repeats else []


def _rounded(layout: Layout, minimum: Minimum, variance: float, alone: bool) -> Array:
    """The covariance of J'r over the joint vector by what encoders round, (0, 0) where there are none; others are white.

    `alone` says that there is nothing but rounding; else what the residuals have beyond Q²/12 is noise before it.
    """
    size, found = len(minimum.theta), False
    out = np.zeros((size, size))
    sines: dict[int, Array] = {}
    for record, prediction, place in zip(layout.data, minimum.predictions, layout.columns(), strict=True):
        j, path = prediction.jacobian[prediction.valid], prediction.y[prediction.valid]
        if not record.quantum or not is_rounded(record):
            out[np.ix_(place, place)] += variance * j.T @ j
            continue
        found = True
        beyond = 0.0 if alone else max(variance / record.quantum**2 - 1 / 12, 0.0)
        own, white = rounding_sines(j, path, record.quantum, beyond)
        out[np.ix_(place, place)] += white
        # Stretches of one recording were rounded by the same counts, and have one source.
        sines.setdefault(id(record.source), np.zeros((len(own), size)))[:, place] += own
    return out + sum(s.T @ s for s in sines.values()) if found else np.empty((0, 0))


def remarks(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> list[Finding]:
    """Return what the search itself has to say."""
    found = []
    if not minimum.converged:
        found.append(
            warning(
                "search-not-settled", f"The search for the parameters {minimum.status}; they may be wrong."
            )
        )
    lower, upper = structure.bounds(data)
    for parameter, value, low, high in zip(structure.parameters, minimum.theta, lower, upper, strict=False):
        if low < value < high:
            continue
        sentence = (
            f"The {parameter.name.replace('_', ' ')} ended at the edge of what is possible, {value:.3g}: "
        )
        if value == 0:
            sentence += "the data show none of it."
            found.append(info("parameter-at-bound", sentence, parameters=(parameter.name,)))
        else:
            sentence += "the model doesn't suit these data, or the columns are out of step."
            found.append(warning("parameter-at-bound", sentence, parameters=(parameter.name,)))
    return found

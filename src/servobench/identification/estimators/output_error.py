"""Output error: the model is simulated from the input alone, and the sum of the squared residuals is minimised."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.core.probability import log_normal_below
from servobench.core.rounding import milliseconds
from servobench.identification.estimators import delay_prior
from servobench.identification.estimators.base import (
    ESTIMATORS,
    Abilities,
    Fit,
    FittedRecord,
    hindrance,
    too_few,
)
from servobench.identification.estimators.covariance import conservative, inverse, sandwich_from_bread
from servobench.identification.estimators.delay_across import with_delay_across
from servobench.identification.estimators.delay_prior import DelayPrior, prior_of_delay, where_expected
from servobench.identification.estimators.encoder_rounding import (
    counts_in_place,
    is_rounded,
    noise_before,
    rounding_sines,
)
from servobench.identification.estimators.friction_across import with_friction_across
from servobench.identification.estimators.gain_sign import with_usual_sign
from servobench.identification.estimators.least_squares import (
    Layout,
    Minimum,
    NormalEquations,
    information,
    jacobian_and_residual,
    lowest,
    square_jacobians,
)
from servobench.identification.estimators.near_bounds import intervals_near_bounds
from servobench.identification.estimators.one_sine import with_neighbours
from servobench.identification.estimators.other_minima import other_minima
from servobench.identification.estimators.repetition import fold, period, repeats
from servobench.identification.estimators.structure_errors import WeightedRecord, of_known_errors
from servobench.identification.estimators.usual_friction import with_usual_friction
from servobench.identification.models.base import STRUCTURES, Model, Prediction, Structure, as_protocol
from servobench.identification.models.first_motion import changes_of_input
from servobench.identification.models.level import one_level
from servobench.recordings.measurement.dataset import Dataset

_ROUNDED = 1e-3  # of two standard deviations: halves of a covariance that differ by more are rounding error
_ONE = 0.98  # a correlation of gain and friction from which they are known together only


@runtime_checkable
class StartStateGuesses(Protocol):
    """A structure that knows where to search for a record's start state alone, without guessing the parameters first."""

    def starts(self, theta: Array, data: Dataset) -> tuple[Array, ...]:
        """Return start vectors (P + Q,) with the parameters theta (P,); raises `NotIdentifiable` as `guesses` does."""
        ...


class OutputError:
    """Minimises Σ (y - ŷ(θ))², ŷ simulated from the input alone and carried through the measurement chain.

    Right for white measurement noise, such as an encoder's rounding; its standard deviations are the larger of the plain
    ones and of those that allow for coloured residuals. Records share the parameters; each has its own start state. The model
    of the noise is that of Ljung 1999, section 4.2.
    """

    abilities = Abilities(
        method="simulates the model from the input alone and minimises the residual, chain and delay included",
        noise="white measurement noise, such as an encoder's rounding",
        interval="covers; allows for coloured residuals; a little narrow under a random torque",
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
        minimum = with_neighbours(structure, data, lowest(structure, data, starts or structure.guesses(data)))
        minimum = with_friction_across(structure, data, with_delay_across(structure, data, minimum))
        minimum = with_usual_friction(structure, data, with_usual_sign(structure, data, minimum))
        return fit_minimum(structure, data, minimum)


ESTIMATORS.member("output_error")(OutputError())


def fit_minimum(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> Fit:
    """Return the fit that a minimum of the squared residuals stands for, or the place beside it where the delay is usual."""
    fit, minimum, prior = _roughly(structure, data, minimum)
    variance = fit.residual_sd**2
    intervals = intervals_near_bounds(structure, data, minimum, fit.covariance, variance, prior)
    return replace(fit, intervals=intervals)


def fit_minimum_roughly(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> Fit:
    """Return the same fit without the intervals of parameters near a bound, each of which takes a dozen searches."""
    return _roughly(structure, data, minimum)[0]


def _roughly(
    structure: Structure, data: Sequence[Dataset], minimum: Minimum
) -> tuple[Fit, Minimum, DelayPrior | None]:
    """The fit, the place that it is at, and the prior of a delay that isn't determined."""
    variance, covariance = uncertainty(structure, data, minimum)
    ends = (*minimum.others, (minimum.theta, minimum.cost))
    findings: list[Finding] = []
    used: DelayPrior | None = None
    # A richer structure begins where a plain one ended, whose delay was expected already; each further search of it takes long.
    prior = prior_of_delay(structure, data) if as_protocol(structure, NormalEquations) else None
    if prior is not None:
        sd = float(np.sqrt(covariance[prior.at, prior.at]))
        usual = where_expected(structure, data, minimum, sd, prior)
        if usual is not None:
            minimum, used = usual
            minimum = with_usual_friction(structure, data, minimum, held=(used.at,))
            variance, covariance = uncertainty(structure, data, minimum, used)
            findings.append(delay_prior.finding(minimum, used))
    sd = float(np.sqrt(variance))
    records = simulations(structure, data, minimum.theta, minimum.predictions)
    fit = Fit(
        model=Model(structure=structure, theta=minimum.theta[: len(structure.parameters)], data=data[0]),
        covariance=covariance,
        estimator="output_error",
        structure=STRUCTURES.name_of(structure),
        converged=minimum.converged,
        status=minimum.status,
        residual_sd=sd,
        records=tuple(replace(record, innovations=record.residual / (sd or 1.0)) for record in records),
        findings=(*remarks(structure, data, minimum), *findings),
    )
    samples = sum(int(each.valid.sum()) for each in minimum.predictions)
    scales = [n for n, each in enumerate(structure.parameters) if each.name in ("gain", "time_constant")]
    apart = other_minima(minimum, ends, covariance, samples, scales, prior, one_level(structure, data))
    return (fit.widen(apart) if apart else fit), minimum, used


def simulations(
    structure: Structure,
    data: Sequence[Dataset],
    theta: Array,
    predictions: Sequence[Prediction] | None = None,
) -> tuple[FittedRecord, ...]:
    """Return each record simulated with its part of theta (P + ΣQ,); without a noise model its innovations are its residuals.

    `predictions` are those of the records with that vector, if they exist already.
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


def uncertainty(
    structure: Structure, data: Sequence[Dataset], minimum: Minimum, prior: DelayPrior | None = None
) -> tuple[float, Array]:
    """Return the variance of the residuals and the covariance (P, P) of the shared parameters at a minimum.

    With a `prior` the delay is also known to its scale. Raises `NotIdentifiable` where there are no more
    samples than unknowns.
    """
    layout = Layout(structure, tuple(data))
    used = sum(int(p.valid.sum()) for p in minimum.predictions)
    freedom = used - len(minimum.theta)
    if freedom <= 0:
        raise too_few(used, len(minimum.theta), data)
    variance = minimum.cost / freedom
    covariance = _covariance(layout, minimum, variance, prior)
    return variance, covariance[: layout.shared, : layout.shared]


def _covariance(layout: Layout, minimum: Minimum, variance: float, prior: DelayPrior | None = None) -> Array:
    """The covariance of the joint vector.

    A parameter at a bound that is a limit of nature, such as no friction, is held there for the others' sake; its own standard
    deviation is that of a free one. A parameter that the data say nothing about has an infinite one.

    Nothing is held where a delay ends at its bound, which allows for columns out of step and is no place where motors are. As
    the truth lies within the bounds, the bound brings the estimate no farther from it, measured by H (a projection onto a convex
    set): the covariance of a free delay is enough, that of a held one would take the bound for the delay. Nor is friction
    held where the data show hardly more than what gain and friction make together of one level.
    """
    squares = square_jacobians(layout, minimum.predictions)
    h = information(layout, squares)
    lower, upper = layout.bounds()
    held = ((minimum.theta <= lower) & (lower >= 0)) | (minimum.theta >= upper)
    held[: layout.shared] &= [p.name != "delay" for p in layout.structure.parameters]
    if held.any():
        held &= ~_is_one_with_gain(layout, inverse(h))
    if prior is not None:
        h[prior.at, prior.at] += variance / prior.scale**2
    bread = inverse(h * np.outer(~held, ~held) if held.any() else h)
    covariance = _of_noise(layout, minimum, variance, bread, squares)
    if variance > 0:
        known = _weigh_records(layout, minimum, variance)
        covariance += of_known_errors(layout.structure, known, variance * bread)
    if held.any():
        free = inverse(h)
        covariance[held, held] = variance * np.diag(free)[held]
        covariance += _of_held(layout, minimum, variance, free, held)
    if prior is not None:
        column = (
            bread[:, prior.at] * variance / prior.scale if prior.along is None else prior.along * prior.scale
        )
        covariance += np.outer(column, column)
    unknown = np.diag(h) == 0
    covariance[unknown, unknown] = np.inf
    return covariance


def _is_one_with_gain(layout: Layout, free: Array) -> NDArray[np.bool_]:
    """Whether an entry of the joint vector is a friction that the data hardly tell from the gain; `free` is (J'J)⁻¹."""
    names = [parameter.name for parameter in layout.structure.parameters]
    among = np.zeros(len(free), dtype=bool)
    if {"gain", "coulomb_voltage"} <= set(names):
        gain, friction = names.index("gain"), names.index("coulomb_voltage")
        among[friction] = free[gain, friction] ** 2 > _ONE**2 * free[gain, gain] * free[friction, friction]
    return among


def _of_held(
    layout: Layout, minimum: Minimum, variance: float, free: Array, held: NDArray[np.bool_]
) -> Array:
    """The others' additional covariance if a parameter held at its bound may lie beyond it, on the possible side.

    `free` is (J'J)⁻¹ (P, P). The free estimate is a from the bound, on the wrong side, with a standard deviation s; the truth's
    distance is a normal one cut at zero, with a mean square q, and moves the others by their slopes along it.
    """
    added = np.zeros_like(free)
    score = _sum_of_scores(layout, minimum)
    for n in np.flatnonzero(held[: layout.shared]):
        if not variance * free[n, n] > 0:
            continue
        sd, away = float(np.sqrt(variance * free[n, n])), -abs(float(free[n] @ score))
        slope = np.where(held, 0.0, free[:, n] / free[n, n])
        added += mean_square_beyond(away, sd) * np.outer(slope, slope)
    return added


def mean_square_beyond(mean: float, sd: float) -> float:
    """Return E[x²] of a normal x that is known to be at least zero."""
    a = -mean / sd
    hazard = float(np.exp(-0.5 * a**2 - 0.5 * np.log(2 * np.pi) - log_normal_below(-a)))
    return max(sd**2 + mean * (mean + sd * hazard), 0.0)


def _sum_of_scores(layout: Layout, minimum: Minimum) -> Array:
    """J'r of all records over the joint vector (P + ΣQ,)."""
    total = np.zeros(len(minimum.theta))
    for record, prediction, place in zip(layout.data, minimum.predictions, layout.columns(), strict=True):
        j, r = jacobian_and_residual(record, prediction)
        total[place] += j.T @ r
    return total


def _of_noise(
    layout: Layout, minimum: Minimum, variance: float, bread: Array, squares: Sequence[Array]
) -> Array:
    """The covariance of the joint vector by what the residuals are: the encoders' rounding alone, or noise of any colour.

    `bread` is (J'J)⁻¹, `squares` are the records' own J'J.
    """
    residuals = [r.y - p.y for r, p in zip(layout.data, minimum.predictions, strict=True)]
    alone = counts_in_place(layout.data, residuals, len(minimum.theta))
    rounded = _rounding_covariance(layout, minimum, variance, alone, squares)
    exact = bread @ rounded @ bread if rounded.size else None
    if exact is None or not _is_resolved(exact):
        return _robust(layout, minimum, variance, bread)
    return exact if alone else conservative(_robust(layout, minimum, variance, bread), exact)


def _is_resolved(covariance: Array) -> bool:
    """Whether a product of matrices is a covariance, or rounding error: data that say next to nothing of a direction leave that.

    What rounds shows in the two halves, which differ, or as a variance below zero.
    """
    variances = np.diag(covariance)
    if not (variances >= 0).all():
        return False
    deviations = np.sqrt(variances)
    sizes = np.outer(deviations, deviations)
    return bool((np.abs(covariance - covariance.T) <= _ROUNDED * sizes).all())


def _robust(layout: Layout, minimum: Minimum, variance: float, bread: Array) -> Array:
    """The covariance of the joint vector for coloured residuals, and for such as repeat with the input."""
    scores = _scores(layout, minimum)
    covariance = conservative(variance * bread, sandwich_from_bread(bread, scores))
    repeated = _fold_scores(layout, minimum, scores)
    return conservative(covariance, sandwich_from_bread(bread, repeated)) if repeated else covariance


def simulate_record(structure: Structure, theta: Array, data: Dataset) -> FittedRecord:
    """Return a record simulated with parameters theta (P,) that are held; only its own start state is fitted."""
    minimum = with_start_fitted(structure, theta, data)
    return simulations(structure, [data], minimum.theta, minimum.predictions)[0]


def with_start_fitted(structure: Structure, theta: Array, data: Dataset) -> Minimum:
    """Return the minimum (P + Q,) over a record's own start state, with parameters theta (P,) held."""
    guessing = as_protocol(structure, StartStateGuesses)
    if guessing is not None:
        starts = guessing.starts(theta, data)
    else:
        starts = tuple(np.concatenate([theta, guess[len(theta) :]]) for guess in structure.guesses([data]))
    free = np.arange(len(starts[0])) >= len(theta)
    return lowest(structure, [data], starts, free)


def _weigh_records(layout: Layout, minimum: Minimum, variance: float) -> list[WeightedRecord]:
    """The records at a minimum, each sample with the same variance of its noise."""
    weighted_records = []
    for record, prediction, place in zip(layout.data, minimum.predictions, layout.columns(), strict=True):
        j, r = jacobian_and_residual(record, prediction)
        weight, used = np.full(len(r), 1.0 / variance), prediction.valid
        weighted_records.append(
            WeightedRecord(
                data=record,
                theta=minimum.theta[place],
                place=place,
                jacobian=j,
                weight=weight,
                score=weight * r,
                used=used,
            )
        )
    return weighted_records


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


def _fold_scores(layout: Layout, minimum: Minimum, scores: Sequence[Array]) -> list[Array]:
    """The scores of all records, summed over the input's periods where the residual repeats; none where no record's does."""
    out, any_repeats = [], False
    for record, prediction, s in zip(layout.data, minimum.predictions, scores, strict=True):
        cycle = period(record) if len(s) == len(record.y) else None
        again = cycle is not None and repeats(record.y - prediction.y, cycle)
        any_repeats |= again
        out.append(fold(s, cycle) if again and cycle is not None else s)
    return out if any_repeats else []


def _rounding_covariance(
    layout: Layout, minimum: Minimum, variance: float, alone: bool, squares: Sequence[Array]
) -> Array:
    """The covariance of J'r over the joint vector by what encoders round, (0, 0) where there are none; others are white.

    `alone` says that there is nothing but rounding; else what the residuals have beyond Q²/12 is noise before it.
    `squares` are the records' own J'J.
    """
    size, has_rounding = len(minimum.theta), False
    out = np.zeros((size, size))
    sines: dict[int, Array] = {}
    places = layout.columns()
    for record, prediction, place, square in zip(
        layout.data, minimum.predictions, places, squares, strict=True
    ):
        if not record.quantum or not is_rounded(record):
            out[np.ix_(place, place)] += variance * square
            continue
        has_rounding = True
        beyond = 0.0 if alone else noise_before(float(np.sqrt(variance)), record.quantum)
        j, _ = jacobian_and_residual(record, prediction)
        path = prediction.y if len(j) == len(prediction.y) else prediction.y[prediction.valid]
        own, white = rounding_sines(j, path, record.quantum, beyond)
        out[np.ix_(place, place)] += white * square
        # Stretches of one recording were rounded by the same counts, and have one source.
        sines.setdefault(id(record.source), np.zeros((len(own), size)))[:, place] += own
    return out + sum(s.T @ s for s in sines.values()) if has_rounding else np.empty((0, 0))


def remarks(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> list[Finding]:
    """Return what the search itself has to say."""
    findings = []
    if not minimum.converged:
        findings.append(
            warning(
                "search-not-settled", f"The search for the parameters {minimum.status}; they may be wrong."
            )
        )
    lower, upper = structure.bounds(data)
    for parameter, value, low, high in zip(structure.parameters, minimum.theta, lower, upper, strict=False):
        if low < value < high:
            continue
        if parameter.name == "delay":
            # What it is worth shows in its interval: `trust.doubts.delay` says so where it means something.
            later = (
                "; after other changes of the input it may be longer"
                if changes_of_input(data) > len(data)
                else ""
            )
            end = (
                "shortest that misaligned columns allow"
                if value <= low
                else f"longest that the first motion allows{later}"
            )
            sentence = f"The fit puts the delay at {milliseconds(float(value))} ms, the {end}."
            findings.append(info("parameter-at-bound", sentence, parameters=("delay",)))
            continue
        words = parameter_in_words(parameter.name, parameter.unit_in(data[0]))
        sentence = f"The {words} ended at the limit of its range, {value:.3g}: "
        if value == 0:
            sentence += "the model explains the data equally well without it."
            findings.append(info("parameter-at-bound", sentence, parameters=(parameter.name,)))
        else:
            sentence += "the model doesn't suit these data, or the columns are misaligned."
            findings.append(warning("parameter-at-bound", sentence, parameters=(parameter.name,)))
    return findings

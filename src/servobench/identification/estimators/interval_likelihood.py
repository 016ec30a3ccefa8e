"""Interval likelihood: a count gives the bin of the position, and nothing about the place within the bin.

With Gaussian noise of standard deviation s before the encoder rounds, a sample in the bin lo ≤ θ + noise < hi has the probability

    P = Φ((hi - θ)/s) - Φ((lo - θ)/s)

and Σ ln P is maximised over the parameters and s. If s is small, a sample near an edge of its bin gives the position to within
s, and one in the middle almost nothing: the information of a sample is 1.81/(s Q) on average, against 12/Q² with rounding
treated as noise. From s = 0.3 Q on the two are the same.

Given the path of the shaft, the scores ∂ ln P/∂θ of the samples are independent, however regular the rounding itself is. So the
inverse of the information is the covariance, at any s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, info, refusal, warning
from servobench.identification.estimators.base import (
    ESTIMATORS,
    Abilities,
    Fit,
    FittedRecord,
    hindrance,
    too_few,
)
from servobench.identification.estimators.covariance import conservative, inverse, sandwich
from servobench.identification.estimators.interval.bins import Bins
from servobench.identification.estimators.interval.noise import NoiseProfile, profile_noise
from servobench.identification.estimators.interval.search import Near, Optimum, search_maximum
from servobench.identification.estimators.interval.wander import wander_ratio
from servobench.identification.estimators.least_squares import Layout, Minimum, lowest
from servobench.identification.estimators.output_error import remarks, simulations
from servobench.identification.estimators.structure_errors import WeightedRecord, of_known_errors
from servobench.identification.models.base import STRUCTURES, Model, Structure
from servobench.recordings.measurement.dataset import Dataset

_INFORMED = 8.0  # samples within s of an edge for each unknown, the least that a search leaves
_EVEN = 0.02  # of a quantum: no encoder's edges are where they should be to better than that
_ON_GRID = 0.02  # of a quantum: how far a value may lie off the grid, by digits that were cut
_NO_GAIN = 0.3  # of a quantum: noise from which a bin says as much as its middle
_DOUBT = 5.41  # the likelihood ratio for a random torque that 1 in 100 records without one exceeds
_MISCOUNT = 6.0  # standard deviations of the noise beyond the edge of its bin: 1 in a thousand million


class IntervalLikelihood:
    """Maximises Σ ln P(lo ≤ θ + noise < hi) over the parameters and the noise before the encoder's rounding.

    Right for white measurement noise before an encoder with even lines, and no random torque. The level of the noise is found
    by its likelihood, adjusted for the parameters that were fitted (Cox and Reid 1987); its uncertainty is in the intervals.
    """

    abilities = Abilities(
        method="treats a count as a bin, not as the bin's middle, and estimates the noise before rounding",
        noise="white noise before the encoder's rounding, best below a fifth of a count",
        interval="covers; wider than necessary with almost no noise before rounding",
        position=True,
        speed=False,
        chain=False,
        irregular_times=True,
        several_records=True,
        closed_loop=True,
        delay=True,
        friction=True,
        disturbance=False,
    )

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return a refusal for data that aren't the plain positions of an encoder whose step is known."""
        lacking = hindrance("interval_likelihood", self.abilities, structure, data)
        if lacking is not None:
            return lacking
        for record in data:
            reason = _no_bins(record)
            if reason:
                return refusal("estimator-unsuited", f"interval_likelihood {reason}")
        return None

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the fit, from where output error ends or from start vectors; raises `NotIdentifiable`."""
        lacking = self.supports(structure, data)
        if lacking is not None:
            raise NotIdentifiable(lacking.sentence.rstrip("."))
        first = lowest(structure, data, starts or structure.guesses(data))
        layout = Layout(structure, tuple(data))
        floor = _floor(layout)
        optimum = search_maximum(layout, first.theta, _first_noise(data, first), floor)
        return _fit_from(layout, optimum, profile_noise(optimum, floor))


ESTIMATORS.member("interval_likelihood")(IntervalLikelihood())


def _no_bins(data: Dataset) -> str | None:
    """The reason why a record's values aren't bins of an encoder; None if they are."""
    if not data.quantum:
        return (
            f"needs the encoder's step, which {data.name} doesn't give: give the output in counts, or its "
            "resolution, or use output_error"
        )
    steps = np.diff(data.y) / data.quantum
    off = float(np.abs(steps - np.round(steps)).max(initial=0.0))
    if off > _ON_GRID:
        return (
            f"needs values that are whole steps of {data.quantum:.6g} {data.output_unit} apart, and some of "
            f"{data.name} are {off:.2g} of a step off: the resolution is wrong, or the values were smoothed; "
            "output_error can use them"
        )
    return None


def _floor(layout: Layout) -> float:
    """The smallest s that is tried [unit of the output]: 0.02 Q, or more for a short record, up to 0.3 Q.

    2 s/Q of the samples are within s of an edge, and the others say next to nothing: with too few of them for each unknown the
    likelihood isn't quadratic, and s would run to zero. From 0.3 Q on all samples tell the same.
    """
    unknowns = int(layout.columns()[-1][-1]) + 1
    enough = _INFORMED * unknowns / sum(2 * len(record.y) / _quantum(record) for record in layout.data)
    smallest = min(_quantum(record) for record in layout.data)
    return float(np.clip(enough, _EVEN * smallest, _NO_GAIN * smallest))


def _quantum(data: Dataset) -> float:
    return float(data.quantum or np.nan)


def _first_noise(data: Sequence[Dataset], first: Minimum) -> float:
    """A first s: what the residuals of output error leave beside the rounding, a tenth of a bin at the least.

    Raises `NotIdentifiable` where there are no more samples than unknowns.
    """
    samples = sum(len(record.y) for record in data)
    if samples <= len(first.theta):
        raise too_few(samples, len(first.theta), data)
    quantum = max(_quantum(record) for record in data)
    variance = first.cost / (samples - len(first.theta))
    return float(np.sqrt(max(variance - quantum**2 / 12, (0.1 * quantum) ** 2)))


def _fit_from(layout: Layout, optimum: Optimum, noise: NoiseProfile) -> Fit:
    """The fit that a maximum and what is known of s stand for."""
    structure, data = layout.structure, layout.data
    lower, upper = layout.bounds()
    theta = optimum.near.theta if optimum.at_kink else optimum.near.theta + noise.best.change
    theta = np.clip(theta, lower, upper)
    all_bins = optimum.near.bins_at(noise.best)
    covariance = _covariance(layout, optimum.near, noise, all_bins)[: layout.shared, : layout.shared]
    records = simulations(structure, data, theta)
    squares = sum(float(record.residual @ record.residual) for record in records)
    samples = sum(len(record.residual) for record in records)
    ended = Minimum(
        theta=theta,
        predictions=(),
        cost=-optimum.point.log_likelihood,
        converged=optimum.converged,
        status=optimum.status,
    )
    return Fit(
        model=Model(structure=structure, theta=theta[: layout.shared], data=data[0]),
        covariance=covariance,
        estimator="interval_likelihood",
        structure=STRUCTURES.name_of(structure),
        converged=optimum.converged,
        status=optimum.status,
        residual_sd=float(np.sqrt(squares / max(samples - len(theta), 1))),
        records=_with_scores(records, all_bins),
        findings=(
            *remarks(structure, data, ended),
            _about_noise(noise, data[0]),
            *_about_miscounts(records, noise.best.s),
            *_about_torque(layout, optimum.near, all_bins, noise.best.s),
        ),
    )


def _covariance(layout: Layout, near: Near, noise: NoiseProfile, all_bins: Sequence[Bins]) -> Array:
    """The covariance of the joint vector: the larger of the inverse information and one that allows for coloured scores.

    As with output error, a parameter at its bound is held there for the others' sake and has the standard deviation of a free
    one; what the structure knows that it can't resolve is added.
    """
    best = noise.best
    scores = _scores(near, all_bins)
    covariance = noise.widen(conservative(inverse(best.information), sandwich(best.information, scores)))
    covariance += of_known_errors(
        layout.structure, _weigh_records(layout, near, all_bins), inverse(best.information)
    )
    everything = replace(near, free=np.ones_like(near.free)).at(best.change, best.s).information
    held = ~near.free
    covariance[held, held] = np.diag(inverse(everything))[held]
    unknown = np.diag(everything) == 0
    covariance[unknown, unknown] = np.inf
    return covariance


def _scores(near: Near, all_bins: Sequence[Bins]) -> list[Array]:
    """The scores of each record over the joint vector, (M, P + ΣQ)."""
    scores = []
    for j, place, bins in zip(near.jacobians, near.places, all_bins, strict=True):
        score = np.zeros((len(j), len(near.theta)))
        score[:, place] = j * bins.score[:, None]
        scores.append(score * near.free)
    return scores


def _weigh_records(layout: Layout, near: Near, all_bins: Sequence[Bins]) -> list[WeightedRecord]:
    """The records at the maximum, each sample with what its bin tells."""
    return [
        WeightedRecord(
            data=record,
            theta=near.theta[place],
            place=place,
            jacobian=j,
            weight=bins.information,
            score=bins.score,
            used=np.ones(len(j), dtype=bool),
        )
        for record, j, place, bins in zip(layout.data, near.jacobians, near.places, all_bins, strict=True)
    ]


def _with_scores(records: Sequence[FittedRecord], all_bins: Sequence[Bins]) -> tuple[FittedRecord, ...]:
    """The records with their scores for innovations, of unit variance over all of them: they point as residuals do."""
    power = float(np.mean(np.concatenate([bins.score for bins in all_bins]) ** 2)) or 1.0
    return tuple(
        replace(record, innovations=bins.score / np.sqrt(power))
        for record, bins in zip(records, all_bins, strict=True)
    )


def _about_noise(noise: NoiseProfile, data: Dataset) -> Finding:
    quantum = _quantum(data)
    s, (low, high) = noise.best.s / quantum, (edge / quantum for edge in noise.interval)
    if noise.at_floor:
        return info(
            "noise-below-rounding",
            f"Noise before the encoder's rounding, if there is any, is below {high:.2g} of a count. It is assumed to be "
            f"{s:.2g}, so the intervals are too wide rather than too narrow.",
        )
    sentence = f"The noise before the encoder's rounding is {s:.2g} of a count ({low:.2g} to {high:.2g})"
    if s >= _NO_GAIN:
        sentence += (
            ": with that much noise the bin says no more than its middle, and output_error does as well"
        )
    return info("noise-before-rounding", sentence + ".")


def _about_miscounts(records: Sequence[FittedRecord], s: float) -> list[Finding]:
    """A warning for each record with counts that no noise explains: they raise the noise level for all others."""
    findings = []
    for record in records:
        quantum = _quantum(record.data)
        beyond = (np.abs(record.residual) - 0.5 * quantum) / s
        worst, wrong = int(np.argmax(beyond)), int(np.count_nonzero(beyond > _MISCOUNT))
        if wrong:
            sentence = (
                f"{record.data.name}: {'a sample is' if wrong == 1 else f'{wrong} samples are'} too far off for noise"
                f"{':' if wrong == 1 else ', the worst by'} {record.residual[worst] / quantum:+.3g} counts at "
                f"{record.data.t_output[worst]:.6g} s. That makes all other samples look noisier; leave "
                f"{'it' if wrong == 1 else 'them'} out."
            )
            findings.append(warning("counts-off", sentence))
    return findings


def _about_torque(layout: Layout, near: Near, all_bins: Sequence[Bins], s: float) -> list[Finding]:
    """A warning where the scores wander as under a random torque, which is no noise of the measurement."""
    names = [parameter.name for parameter in layout.structure.parameters]
    if "time_constant" not in names:
        return []
    ratio = wander_ratio(layout, near, all_bins, s, float(near.theta[names.index("time_constant")]))
    if ratio <= _DOUBT:
        return []
    return [
        warning(
            "noise-not-of-the-measurement",
            "The residual isn't white measurement noise but wanders, as under a random torque or with an "
            "incomplete model, so the intervals are too narrow. prediction_error allows for a random torque. "
            f"(Likelihood ratio {ratio:.3g}; by chance alone it exceeds {_DOUBT} once in a hundred.)",
            parameters=tuple(names),
        )
    ]

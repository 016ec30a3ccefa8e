"""Refined instrumental variables in a closed loop: the instruments come from the reference, which is independent of the
noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, info, refusal, warning
from servobench.identification.estimators.base import ESTIMATORS, Abilities, Fit, hindrance, too_few
from servobench.identification.estimators.instruments.closed_loop import noise_free_inputs
from servobench.identification.estimators.instruments.noise_colour import autoregression, noise_power
from servobench.identification.estimators.least_squares import Layout, Minimum
from servobench.identification.estimators.output_error import remarks, simulations
from servobench.identification.estimators.srivc import not_rational
from servobench.identification.models.base import STRUCTURES, Model, Prediction, Structure
from servobench.identification.models.rational import Rational
from servobench.identification.models.rational.guesses import reflect_poles
from servobench.recordings.measurement.dataset import Dataset

_PASSES = 40
_HALVINGS = 8
_ENOUGH = 1e-3  # a pass that moves the output by less than this many standard deviations of the estimate is the last
_WEAK = 0.1  # the share of the input's variance below which a reference is a weak instrument


class Clsrivc:
    """Solves Σ z (y - ŷ(θ)) = 0, ŷ simulated from the measured input, z the Jacobian for the input that the reference causes.

    In a closed loop the noise of the output comes back through the input, and least squares are biased; z holds none of it,
    whatever its colour. The controller need not be known (`estimators.instruments.closed_loop`). Standard deviations
    allow for coloured noise.

    Gilson, Garnier, Young and Van den Hof, in Garnier and Wang (eds.), Identification of Continuous-time Models from Sampled
    Data, 2008, chapter 5: the simplified form, without a noise model. They filter the measured signals by 1/A; here the
    simulation error itself is set against the instruments, which has the same root. Söderström and Stoica, Instrumental
    Variable Methods for System Identification, 1983, for the covariance.
    """

    abilities = Abilities(
        method="correlates the simulation error with instruments made from the loop's reference alone",
        noise="any output noise independent of the reference, also coloured noise in a closed loop",
        interval="covers; allows for coloured residuals",
        position=True,
        speed=True,
        chain=True,
        irregular_times=True,
        several_records=True,
        closed_loop=True,
        delay=True,
        friction=False,
        disturbance=False,
    )

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return a refusal for a structure that isn't rational or a record without a reference, None otherwise."""
        lacking = hindrance("clsrivc", self.abilities, structure, data) or not_rational("clsrivc", structure)
        if lacking is not None:
            return lacking
        for record in data:
            reference = record.reference
            if reference is None or np.ptp(reference) == 0:
                has = (
                    "has no reference"
                    if reference is None
                    else f"has a reference that stays at {reference[0]:g}"
                )
                return refusal(
                    "reference-missing",
                    f"{record.name} {has}: clsrivc needs the loop's reference at the times of the input, and it "
                    "must change. Give it, or use srivc if the loop was open.",
                )
        return None

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the root, sought from the first start vector, or from the structure's guess; raises `NotIdentifiable`."""
        lacking = self.supports(structure, data)
        if lacking is not None or not isinstance(structure, Rational):
            raise NotIdentifiable(
                lacking.sentence.rstrip(".") if lacking else "clsrivc needs a rational structure"
            )
        references = [record.reference for record in data if record.reference is not None]
        inputs, share = noise_free_inputs(structure, data, references)
        quiet = [replace(record, u=u) for record, u in zip(data, inputs, strict=True)]
        equations = Equations(structure, Layout(structure, tuple(data)), Layout(structure, tuple(quiet)))
        start = (starts or structure.guesses(data))[0]
        return _fit(equations, _root(equations, start), share)


ESTIMATORS.member("clsrivc")(Clsrivc())


@dataclass(frozen=True, eq=False)
class Equations:
    """Instruments' equations: the structure, the records as `measured`, and `quiet`, with what the reference alone puts in."""

    structure: Rational
    measured: Layout
    quiet: Layout

    def at(self, theta: Array) -> Point:
        """Return what they say at a joint vector (P + ΣQ,)."""
        from servobench.identification.models.rational import kernels

        size = len(theta)
        cross, power, g, cost = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size), 0.0
        predictions, instruments = [], []
        for record, quiet, place in zip(
            self.measured.data, self.quiet.data, self.measured.columns(), strict=True
        ):
            prediction = self.structure.predict(theta[place], record)
            keep = prediction.valid
            z = np.zeros((int(keep.sum()), size))
            z[:, place] = self.structure.predict(theta[place], quiet).jacobian[keep]
            rest = (record.y - prediction.y)[keep]
            products = np.empty((size, size + len(place) + 1))
            kernels.products(z, np.column_stack([z, prediction.jacobian[keep], rest]), products)
            power += products[:, :size]
            cross[:, place] += products[:, size:-1]
            g += products[:, -1]
            cost += float(rest @ rest)
            instruments.append(z)
            predictions.append(prediction)
        return Point(theta, tuple(predictions), tuple(instruments), cross, power, g, cost)


@dataclass(frozen=True, eq=False)
class Point:
    """The equations at a joint vector `theta` (P + ΣQ,): Σ z J' (`cross`), Σ z z' (`power`), Σ z ε (`g`) and Σ ε² (`cost`).

    `instruments` are each record's z (M, P + ΣQ), `predictions` what the structure says of its output.
    """

    theta: Array
    predictions: tuple[Prediction, ...]
    instruments: tuple[Array, ...]
    cross: Array
    power: Array
    g: Array
    cost: float

    def solve(self, right: Array, free: NDArray[np.bool_]) -> Array:
        """Return cross⁻¹ right (P + ΣQ, ...) for the entries that are `free` (P + ΣQ,), 0 for the others.

        Raises `NotIdentifiable` where there is none.
        """
        scale = 1.0 / np.sqrt(np.where(np.diag(self.power) > 0, np.diag(self.power), 1.0))
        part = np.ix_(free, free)
        scaled = (self.cross * np.outer(scale, scale))[part]
        if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > 1e13:
            raise NotIdentifiable(
                "the reference can't separate these parameters; let it change more often or between more levels, or "
                "use a lower order"
            )
        out = np.zeros_like(right)
        columns = right[free].T * scale[free]
        out[free] = (np.linalg.solve(scaled, columns.T).T * scale[free]).T
        return out

    @property
    def merit(self) -> float:
        """The part of the error that the instruments see, g' power⁻¹ g; 0 at the root."""
        scale = 1.0 / np.sqrt(np.where(np.diag(self.power) > 0, np.diag(self.power), 1.0))
        if not np.isfinite(self.cost):
            return float("inf")
        scaled, g = self.power * np.outer(scale, scale), scale * self.g
        return float(g @ np.linalg.lstsq(scaled, g, rcond=1e-13)[0])


def _root(equations: Equations, start: Array) -> tuple[Point, NDArray[np.bool_], Minimum]:
    """Newton's iteration, a step halved where it makes the instruments see more of the error."""
    lower, upper = equations.measured.bounds()
    point = equations.at(np.clip(start, lower, upper))
    samples = sum(int(p.valid.sum()) for p in point.predictions)
    for step in range(1, _PASSES + 1):
        free = _free(point, lower, upper)
        change = point.solve(point.g, free)
        moved = float(change @ point.power @ change)
        if moved <= _ENOUGH**2 * point.cost / samples:
            return point, free, _minimum(point, True, f"converged in {step} steps")
        for halving in range(_HALVINGS):
            to = reflect_poles(equations.structure, point.theta + change * 0.5**halving)
            trial = equations.at(np.clip(to, lower, upper))
            if trial.merit < point.merit:
                break
        point = trial
    return (
        point,
        _free(point, lower, upper),
        _minimum(point, False, f"did not converge within {_PASSES} steps"),
    )


def _free(point: Point, lower: Array, upper: Array) -> NDArray[np.bool_]:
    """The entries that may move: those that the instruments determine and that aren't held at a bound."""
    step = point.g
    held = ((point.theta <= lower) & (step < 0)) | ((point.theta >= upper) & (step > 0))
    return np.asarray((np.diag(point.power) > 0) & ~held)


def _minimum(point: Point, converged: bool, status: str) -> Minimum:
    return Minimum(
        theta=point.theta, predictions=point.predictions, cost=point.cost, converged=converged, status=status
    )


def _fit(equations: Equations, root: tuple[Point, NDArray[np.bool_], Minimum], share: float) -> Fit:
    point, free, minimum = root
    structure, data = equations.structure, equations.measured.data
    shared = equations.measured.shared
    samples = sum(int(p.valid.sum()) for p in point.predictions)
    if samples <= len(point.theta):
        raise too_few(samples, len(point.theta), data)
    sd = float(np.sqrt(point.cost / (samples - len(point.theta))))
    records = simulations(structure, data, point.theta)
    residuals = [record.residual[record.valid] for record in records]
    return Fit(
        model=Model(structure=structure, theta=point.theta[:shared], data=data[0]),
        covariance=_covariance(point, free, residuals)[:shared, :shared],
        estimator="clsrivc",
        structure=STRUCTURES.name_of(structure),
        converged=minimum.converged,
        status=minimum.status,
        residual_sd=sd,
        records=tuple(replace(record, innovations=record.residual / (sd or 1.0)) for record in records),
        findings=(*remarks(structure, data, minimum), _finding(share)),
    )


def _covariance(point: Point, free: NDArray[np.bool_], residuals: Sequence[Array]) -> Array:
    """cross⁻¹ Z'ΓZ cross⁻ᵀ with the residuals' own colour in Γ; infinite for what is held."""
    phi, variance = autoregression(residuals)
    meat = sum((noise_power(z, phi, variance) for z in point.instruments), np.zeros_like(point.cross))
    bread = point.solve(np.eye(len(point.theta)), free)
    covariance = np.asarray(bread @ meat @ bread.T, dtype=np.float64)
    covariance[~free, ~free] = np.inf
    return covariance


def _finding(share: float) -> Finding:
    sentence = f"The instruments come from the loop's reference, which alone causes {100 * share:.0f} % of the input's variation."
    if share >= _WEAK:
        return info("instruments-from-reference", sentence)
    return warning(
        "instruments-weak", f"{sentence} That is little: let the reference change more often or further."
    )

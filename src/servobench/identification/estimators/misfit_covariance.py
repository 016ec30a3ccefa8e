"""The covariance of output error if no noise model is right: the same data with a second weighting.

Friction that depends on speed or angle, play and elastic shafts leave a residual that is neither white noise nor the effect of
a white torque, and it lasts as long as the features of the record. The residuals of one fit don't show its size, because output
error lets the model follow just these slow errors. Two weightings show more: output error mainly fits the slow motion of the
position, prediction error the accelerations. If the model were right, both would find the same motor; their difference is the
effect of the model's error on the parameters. (Hausman 1978 uses such a difference as a test of the model; here it widens the
intervals, docs/decisions/0006-intervals.md.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import SAME, TWO_SIDED, instead_of
from servobench.identification.estimators.base import Fit, IntervalsOnDemand
from servobench.identification.estimators.budget import Contribution, beyond
from servobench.identification.estimators.covariance import conservative, inverse, sandwich_over
from servobench.identification.estimators.delay_prior import prior_of
from servobench.identification.estimators.disturbance import (
    Disturbance,
    WhitenedStructure,
    blocks_of,
    longest_block,
)
from servobench.identification.estimators.friction_across import FRICTION
from servobench.identification.estimators.least_squares import (
    Layout,
    Minimum,
    information,
    minimise,
    square_jacobians,
)
from servobench.identification.estimators.near_bounds import searches_near_bounds
from servobench.identification.estimators.sizes import WEAK, friction_spread, sizes
from servobench.identification.models.base import Structure
from servobench.identification.models.level import single_level
from servobench.recordings.measurement.dataset import Dataset

SOURCE: Final = "choice of noise model"
_MEMORY = 0.1  # of τ: a first-order model need not be right within less
_LAGS = 3.0  # τ: what a torque did to the speed is down to 5 % by then
_ROUNDS = 4
_STEPS = 20  # from where the other weighing ended: one that needs more leads away
_SETTLED = 0.02  # of a standard deviation


def allow_for_misfit(fit: Fit) -> Fit:
    """Return output error's fit with a covariance that allows for an error of the model, of any colour.

        C = max(C₁, C₂ + δ δ'),   δ = θ₁ - θ₂

    θ₁ and C₁ are those of the fit. θ₂ minimises the innovations of a filter for a white torque that remembers a tenth of τ; C₂ is
    its sandwich with lags of 3 τ, right for any colour within that time.
    """
    theta, covariance = _second(fit)
    difference = fit.model.theta - theta
    second = covariance + np.outer(difference, difference)
    if not {"gain", FRICTION} <= set(fit.model.names):
        # With deviations scaled one by one, which would tear apart a gain and a friction that are known together.
        second = conservative(fit.covariance, second)
    reason = "weighted for a random torque, the same data give different values"
    line = Contribution(source=SOURCE, covariance=beyond(second, _without_noise_model(fit)), reason=reason)
    wider = fit.widen(line)
    return replace(
        wider,
        intervals=IntervalsOnDemand(partial(_near_bounds, fit, wider.covariance)),
        findings=(*fit.findings, _finding(wider, theta)),
    )


def _without_noise_model(fit: Fit) -> Array:
    """The covariance (P, P) of the fit itself, by white noise where gain and friction are known together only.

    Either may be of any size there, and the rounding of its variance is more than what is known (see `with_weak_priors`).
    """
    data = tuple(record.data for record in fit.records)
    if single_level(data) is None and not friction_spread(fit) > WEAK:
        return fit.covariance
    minimum, variance, shared = _minimum(fit), fit.residual_sd**2, len(fit.model.theta)
    layout = Layout(fit.model.structure, data)
    h = information(layout, square_jacobians(layout, minimum.predictions))
    return variance * inverse(h + np.diag(variance / (WEAK * sizes(fit)) ** 2))[:shared, :shared]


def _near_bounds(fit: Fit, covariance: Array) -> dict[str, Callable[[], tuple[float, float]]]:
    """What finds the intervals of parameters near a bound, with a wider covariance (P, P) than the fit's."""
    data = [record.data for record in fit.records]
    prior = prior_of(fit)
    return searches_near_bounds(
        fit.model.structure, tuple(data), _minimum(fit), covariance, fit.residual_sd**2, prior
    )


def _second(fit: Fit) -> tuple[Array, Array]:
    """The parameters (P,) and their covariance (P, P) by the other weighing."""
    structure, data = fit.model.structure, tuple(record.data for record in fit.records)
    at, shared, theta = fit.model.names.index("time_constant"), len(fit.model.theta), fit.vector
    for _ in range(_ROUNDS):
        tau = float(theta[at])
        model = _weighting(structure, data, theta, tau)
        minimum = minimise(model, model.whitened_data, theta, steps=_STEPS)
        theta = minimum.theta
        covariance = _covariance(model, minimum, tau, sizes(fit))[:shared, :shared]
        # Where the search slid off to the shortest time constant, the two ways of weighing have nothing in common, and where it
        # found no end, another weighing won't end it.
        slid = theta[at] <= model.bounds(model.whitened_data)[0][at]
        if (
            slid
            or not minimum.converged
            or abs(theta[at] - tau) <= _SETTLED * np.sqrt(max(covariance[at, at], 0.0))
        ):
            break
    return theta[:shared], covariance


def _weighting(
    structure: Structure, data: tuple[Dataset, ...], theta: Array, tau: float
) -> WhitenedStructure:
    """The structure behind a filter that remembers a tenth of τ, or a sample; where the shaft sticks is taken from theta."""
    step = max(record.sample_time for record in data)
    noise = Disturbance.from_memory(max(_MEMORY * tau, step), tau, data[0].kind, step)
    blocks = tuple(
        blocks_of(record, structure.sliding(theta[place], record), longest_block(noise, tau, record))
        for record, place in zip(data, Layout(structure, data).columns(), strict=True)
    )
    return WhitenedStructure(structure, noise, data, blocks)


def _covariance(model: WhitenedStructure, minimum: Minimum, tau: float, size: Array) -> Array:
    """The sandwich of the joint vector, with lags of 3 τ, at most half a record; a parameter at its bound is held there.

    A weak prior of parameters of these sizes (P + ΣQ,) keeps what gain and friction of one level are together.
    """
    layout = Layout(model, model.whitened_data)
    lower, upper = layout.bounds()
    free = (minimum.theta > lower) & (minimum.theta < upper)
    h = information(layout, square_jacobians(layout, minimum.predictions))
    count = sum(int(prediction.valid.sum()) for prediction in minimum.predictions)
    prior = np.diag(minimum.cost / count / (WEAK * size) ** 2)
    scores, lags = [], []
    for record, prediction, place in zip(layout.data, minimum.predictions, layout.columns(), strict=True):
        s = np.zeros((int(prediction.valid.sum()), len(minimum.theta)))
        s[:, place] = (prediction.jacobian * (record.y - prediction.y)[:, None])[prediction.valid]
        scores.append(s)
        lags.append(min(int(_LAGS * tau * len(s) / record.duration), len(s) // 2))
    return sandwich_over((h + prior) * np.outer(free, free), scores, lags)


def _minimum(fit: Fit) -> Minimum:
    """The point where output error's search ended."""
    structure, theta = fit.model.structure, fit.vector
    layout = Layout(structure, tuple(record.data for record in fit.records))
    predictions = tuple(
        structure.predict(theta[place], record)
        for record, place in zip(layout.data, layout.columns(), strict=True)
    )
    cost = sum(float(np.sum(record.residual[record.valid] ** 2)) for record in fit.records)
    return Minimum(
        theta=theta, predictions=predictions, cost=cost, converged=fit.converged, status=fit.status
    )


def _finding(fit: Fit, theta: Array) -> Finding:
    """What the other weighing, which leads to theta (P,), makes of gain and time constant, of those that are known."""
    value = dict(zip(fit.model.names, theta, strict=True))
    symbols = dict(zip(fit.model.names, fit.model.units, strict=True))
    units = {fit.model.names[0]: "", "time_constant": "s"}
    if single_level([record.data for record in fit.records]) is not None:
        del units[fit.model.names[0]]  # it hangs on the friction
    known = [name for name in units if TWO_SIDED * fit.sd(name) < abs(fit.model[name])]
    texts = {
        parameter_in_words(name, symbols[name]): instead_of(value[name], fit.model[name], unit=units[name])
        for name in known
    }
    if not known:
        shift = "Fitted as if that were a random torque, the same data give other values; the intervals allow for the difference."
    elif all(text.endswith(SAME) for text in texts.values()):
        same = " and ".join(f"the {words}" for words in texts)
        shift = f"If that were a random torque, {same} would be the same to four digits."
    else:
        both = " and ".join(f"a {words} of {text}" for words, text in texts.items())
        shift = f"Fitted as if that were a random torque, the same data give {both}; the intervals allow for the difference."
    return info(
        "weighed-twice",
        f"The residual doesn't look like noise: part of it is something the model leaves out. {shift}",
        parameters=tuple(known) or ("gain", "time_constant"),
    )

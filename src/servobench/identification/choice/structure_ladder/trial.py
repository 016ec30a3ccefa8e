"""A trial of a rung: the fit with one more term, and the reasons against it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, warning
from servobench.core.rounding import TWO_SIDED, change_text
from servobench.core.rounding import plain as number
from servobench.identification.choice.structure_ladder.comparison import deviance, shifts_parameters, worth_it
from servobench.identification.estimators.base import ESTIMATORS, Estimator, Fit
from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.estimators.delay_prior import is_usual
from servobench.identification.estimators.least_squares import lowest, minimise
from servobench.identification.estimators.one_sine import are_driven_by_one_sine
from servobench.identification.estimators.output_error import fit_minimum_roughly
from servobench.identification.models.base import STRUCTURES, Structure
from servobench.identification.models.motion import smooth_speed, turns_between_rows
from servobench.identification.models.nonlinear.grammar import with_term
from servobench.identification.trust.validation import explains_the_colour
from servobench.identification.trust.winding import about_winding, sd_of_second_lag
from servobench.identification.uncertainty.score_test import LIMIT
from servobench.recordings.measurement.dataset import Dataset

_TWO_COMPONENTS = 2.448  # standard deviations: √χ² of two degrees of freedom that chance exceeds in 5 of 100
_SELDOM = 2.0  # % of the samples, of which a few may be wrong
_LITTLE = 0.1  # of twice the logarithm of a likelihood by as many samples as the rung below is worth; a rung needs 15 and more
_CHANCE = 0.05  # of the runs without a term, in which it seems likely enough to be worth a word
_FALLS = ((1.0, 1.0), (1.0, 0.3), (0.5, 1.0))  # of its size and of the speed over which it falls
_AT_LIMIT = "it drives a parameter to the limit of its range"
_WITH_WINDING = {
    "first_order": "second_order",
    "first_order_coulomb": "second_order_coulomb",
    "first_order_one_way": "second_order_one_way",
}
_NAMES = {
    "coulomb": "coulomb_voltage",
    "load": "load_friction",
    "asymmetric": "drag_asymmetry",
}
_BOTH_WAYS = ("coulomb_voltage_forward", "coulomb_voltage_backward")
TERMS = {
    "coulomb": "Coulomb friction",
    "stribeck": "friction that falls with the speed",
    "gravity": "gravity on an arm or a pendulum",
    "coulomb_gravity": "gravity and Coulomb friction",
    "asymmetric": "friction that differs by direction",
    "load": "friction that grows with the load",
    "winding": "the winding's lag",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Rung:
    """A rung that was tried: its term, the fit with it as it is (`plain`) and as it is allowed for (`fit`).

    `doubt` is a sentence on why it can't be kept, empty where it can.
    `hidden` is what to say of one that can't be left out for certain, either.
    """

    term: str
    plain: Fit
    fit: Fit
    doubt: str
    hidden: Finding | None = None


def with_added_term(structure: str, term: str) -> str | None:
    """Return the name of the structure with one more term (a rung, or the winding's pole), None if there is none."""
    return _WITH_WINDING.get(structure) if term == "winding" else with_term(structure, term)


def try_rung(
    method: Estimator,
    data: Sequence[Dataset],
    plain: Fit,
    fit: Fit,
    term: str,
    is_significant: bool,
    allow: Callable[[Fit], Fit],
) -> Rung:
    """Return the rung with a term, fitted, and what speaks against it; `is_significant` says that a score test calls for it.

    `plain` is the fit below it as it is, `fit` as it is allowed for, by `allow`.
    """
    structure = STRUCTURES[with_added_term(fit.structure, term) or ""]
    if method.supports(structure, data) is not None:
        return Rung(term=term, plain=plain, fit=fit, doubt=f"{fit.estimator} can't fit it")
    if "gravity" in term and turns_between_rows(data):
        return Rung(
            term=term, plain=plain, fit=fit, doubt="the shaft turns by more than half a turn from row to row"
        )
    try:
        starts = [*_starts_from_below(term, plain, structure, data), *structure.guesses(data)]
        # A valley may go on for long, and hardly down, above all beside a random torque.
        nearest = lowest(structure, data, starts, worth=_LITTLE / _white_samples(plain))
        if not worth_it(nearest, data, plain, among=len(TERMS)):
            return Rung(term=term, plain=plain, fit=fit, doubt="no better fit")
        if method is ESTIMATORS["output_error"]:
            # Most rungs end here; their intervals near bounds, which aren't shown, would take longer than everything else.
            doubt = _early_doubt(
                term, is_significant, fit_minimum_roughly(structure, data, nearest), plain, fit
            )
            if doubt:
                return Rung(term=term, plain=plain, fit=fit, doubt=doubt)
        richer = method.fit(structure, data, (nearest.theta,))
        doubt = _early_doubt(term, is_significant, richer, plain, fit)
        if doubt:
            return Rung(term=term, plain=plain, fit=fit, doubt=doubt)
        allowed = allow(richer)
    except NotIdentifiable as error:
        return Rung(term=term, plain=plain, fit=fit, doubt=str(error))
    doubt, hidden = _doubt(term, is_significant, richer, allowed, fit), None
    # A random torque may have left little for the term.
    if not doubt and _at_the_edge(allowed, fit):
        doubt = _AT_LIMIT
    if not doubt:
        doubt, hidden = feedback_refusal(term, allowed, fit)
    return Rung(term=term, plain=richer, fit=allowed, doubt=doubt, hidden=hidden)


def _white_samples(plain: Fit) -> float:
    """The number of samples of white noise that a fit's residuals are worth."""
    return sum(effective_samples(record.residual[record.valid]) for record in plain.records)


def _early_doubt(term: str, is_significant: bool, richer: Fit, plain: Fit, fit: Fit) -> str:
    """The reason against a rung that shows before a disturbance of the motor is allowed for; empty if there is none."""
    doubt = _doubt(term, is_significant, richer, richer, fit)
    if not doubt and _at_the_edge(richer, plain):
        doubt = _AT_LIMIT
    if not doubt and not explains_the_colour(richer):
        doubt = _doubt(term, is_significant, richer, _copy_allowance(richer, plain, fit), fit)
    return doubt


def _copy_allowance(richer: Fit, plain: Fit, fit: Fit) -> Fit:
    """A rung that explains the colour no better, with the same allowance as the rung below: this needs no search.

    `plain` is the rung below without the allowance, `fit` with it.
    """
    factors = [fit.sd(n) / plain.sd(n) for n in ("gain", "time_constant") if 0 < plain.sd(n) < np.inf]
    return replace(richer, covariance=max([1.0, *factors]) ** 2 * richer.covariance)


def _doubt(term: str, is_significant: bool, richer: Fit, allowed: Fit, fit: Fit) -> str:
    """The reason against a rung even though it explains more; empty if there is none.

    A term of unknown size is only kept if the data need it and its absence would move gain or time constant.
    """
    if not richer.converged:
        return "its search doesn't converge"
    about_lag = about_winding(allowed)
    if about_lag:
        return about_lag[0].sentence
    if any(not allowed.sd(n) < 0.5 * abs(allowed.model[n]) for n in ("gain", "time_constant")):
        return "gain and time constant could no longer be determined"
    if friction_drives(allowed):
        return "friction would drive the motor"
    if not is_usual(allowed) and is_usual(fit):
        return "it takes a delay that is rare"
    if term == "winding" and _is_ahead(allowed) and not _is_ahead(fit):
        return "it has the output ahead of the input"
    if term == "stribeck" and _is_never_slow(allowed):
        return "the shaft never turns as slowly as such a friction takes"
    value, sd = amount(term, allowed)
    if not sd < 0.5 * value and not (is_significant and shifts_parameters(allowed, fit)):
        return f"its size isn't significantly different from zero ({number(value, 2)} ± {number(TWO_SIDED * sd, 1)})"
    return ""


def _is_ahead(fit: Fit) -> bool:
    """Whether a fit's delay is below zero for certain: of the winding, which lags, that is the opposite."""
    if "delay" not in fit.model.names:
        return False
    delay = fit["delay"]
    return delay.value + TWO_SIDED * delay.sd < 0.0


def _is_never_slow(fit: Fit) -> bool:
    """Whether the shaft turns faster all the time than the speed over which friction falls: what it does there isn't seen."""
    speeds = np.concatenate([np.abs(smooth_speed(record.data)) for record in fit.records])
    return bool(np.percentile(speeds, _SELDOM) > fit.model["stribeck_speed"])


def friction_drives(fit: Fit) -> bool:
    """Return whether the Coulomb voltages of the two directions have a negative sum, in which an offset cancels."""
    both = [n for n, name in enumerate(fit.model.names) if name in _BOTH_WAYS]
    if not both:
        return False
    variance = float(fit.covariance[np.ix_(both, both)].sum())
    least = -TWO_SIDED * float(np.sqrt(max(variance, 0.0))) if np.isfinite(variance) else 0.0
    return float(fit.model.theta[both].sum()) < least


def feedback_refusal(term: str, allowed: Fit, fit: Fit) -> tuple[str, Finding | None]:
    """Return why a rung can't be kept where a controller answers to a random torque, and what to say if it can't be left out.

    There a simulation from the input alone lacks what is no part of the motor, and a rung such as gravity, which pulls the shaft
    to a place as the controller does, makes up for it. The innovations don't lack it, and are white: without the term, twice
    the logarithm of their likelihoods' ratio is χ² with a degree of freedom for each parameter more (Wilks 1938). It has to be
    beyond the limit of the score tests, and worth the parameters by Schwarz's criterion.
    """
    from scipy.special import chdtri, ndtr

    if allowed.disturbance is None or not any(record.data.closed_loop for record in allowed.records):
        return "", None
    more = max(len(allowed.vector) - len(fit.vector), 1)
    samples = sum(int(record.valid.sum()) for record in allowed.records)
    worth = deviance(fit) - deviance(allowed)
    needed = max(float(chdtri(more, 2 * ndtr(-LIMIT))), more * float(np.log(samples)))
    if worth > needed:
        return "", None
    doubt = f"given the random torque, it explains little: likelihood ratio {number(worth, 2)}, limit {number(needed, 2)}"
    chance = float(chdtri(more, _CHANCE))
    if worth <= chance or not shifts_parameters(allowed, fit):
        return doubt, None
    sentence = (
        f"This closed loop doesn't show whether there is {TERMS[term]}, with which the gain would be "
        f"{change_text(allowed.model['gain'], fit.model['gain'])}. The likelihood ratio, {number(worth, 2)}, is seldom due to "
        f"chance (once in 20 runs it exceeds {number(chance, 2)}), but the controller responds to a random torque: "
        "record a longer run, larger steps, or an open loop."
    )
    return doubt, warning("term-hidden", sentence, parameters=("gain", "time_constant"))


def _at_the_edge(richer: Fit, plain: Fit) -> bool:
    """Whether a rung drives a parameter to the edge of what is possible: then its term stands for something else.

    Friction that falls up to the largest speed is viscous friction, and a motor without a time constant is none. That a parameter
    of the simpler structure becomes zero is nothing bad: the new term may be what it stood for.
    """
    data = [record.data for record in richer.records]
    at_edge = []
    for fit in (richer, plain):
        lower, upper = fit.model.structure.bounds(data)
        values = zip(fit.model.names, fit.model.theta, lower, upper, strict=True)
        at_edge.append({name for name, value, low, high in values if not low < value < high})
    old = set(plain.model.names)
    zero = {name for name in old if name in richer.model.names and richer.model[name] == 0}
    return bool(at_edge[0] - at_edge[1] - zero)


def is_certain(term: str, fit: Fit) -> bool:
    """Return whether a term's size differs from zero at 95 %: by χ² of as many components as it has."""
    value, sd = amount(term, fit)
    return sd * (_TWO_COMPONENTS if "gravity" in term else 2.0) < value


def amount(term: str, fit: Fit) -> tuple[float, float]:
    """Return how much of a term a fit has, with its standard deviation: of Stribeck friction u_s ω_s, which reversals tell."""
    names = fit.model.names
    value, slope = 0.0, np.zeros(len(names), dtype=np.float64)
    if term == "winding":
        return float(fit.model["electrical_time_constant"]), sd_of_second_lag(fit)
    if term == "stribeck":
        u, speed = (names.index(n) for n in ("stribeck_voltage", "stribeck_speed"))
        value = float(fit.model.theta[u] * fit.model.theta[speed])
        slope[u], slope[speed] = fit.model.theta[speed], fit.model.theta[u]
    elif term in ("gravity", "coulomb_gravity"):
        both = [names.index(n) for n in ("gravity_voltage_sine", "gravity_voltage_cosine")]
        value = float(np.hypot(*fit.model.theta[both]))
        slope[both] = fit.model.theta[both] / (value or 1.0)
    else:
        at_one = names.index(_NAMES[term])
        value = abs(float(fit.model.theta[at_one]))
        slope[at_one] = 1.0
    concerned = np.flatnonzero(slope)
    covariance = fit.covariance[np.ix_(concerned, concerned)]
    if not np.isfinite(covariance).all():
        return value, np.inf
    variance = float(slope[concerned] @ covariance @ slope[concerned])
    return value, float(np.sqrt(max(variance, 0.0)))


def _starts_from_below(term: str, plain: Fit, structure: Structure, data: Sequence[Dataset]) -> list[Array]:
    """Start vectors (P + ΣQ,) of a rung from the simpler fit.

    Under one sine a delay has taken the place of friction that falls with the speed, in a minimum of its own: one leaves it by
    holding such a friction, of several sizes, while all else approaches it.
    """
    start = embed(plain, structure, data)
    if term != "stribeck" or not are_driven_by_one_sine(data):
        return [start]
    names = [parameter.name for parameter in structure.parameters]
    at = [names.index(name) for name in ("stribeck_voltage", "stribeck_speed")]
    free = np.ones(len(start), dtype=bool)
    free[at] = False
    starts = []
    for factors in _FALLS:
        with_friction = start.copy()
        with_friction[at] *= factors
        starts.append(minimise(structure, data, with_friction, free).theta)
    return starts


def embed(plain: Fit, structure: Structure, data: Sequence[Dataset]) -> Array:
    """Return the simpler fit as a start vector (P + ΣQ,) of a richer structure, with a little of what is new."""
    value = dict(zip(plain.model.names, plain.model.theta, strict=True))
    coulomb, offset = value.get("coulomb_voltage", 0.0), value.get("offset_voltage", 0.0)
    top = max(float(np.abs(smooth_speed(record)).max()) for record in data)
    little = {
        "coulomb_voltage": max(coulomb, 0.0),
        "coulomb_voltage_forward": coulomb + offset,
        "coulomb_voltage_backward": coulomb - offset,
        "stribeck_voltage": 0.3 * abs(coulomb),
        "stribeck_speed": 0.1 * top,
        "load_friction": 0.05,
        "electrical_time_constant": 0.5 * max(value.get("delay", 0.0), 0.0),
    }
    shared = [value.get(p.name, little.get(p.name, 0.0)) for p in structure.parameters]
    return np.concatenate([shared, *(record.nuisance for record in plain.records)])

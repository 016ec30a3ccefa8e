"""The choice of a structure: a base that the motion calls for, then a rung of the ladder for each term that the data ask for.

The score tests propose: they cost no fit, so that data which ask for nothing cost nothing. A proposed rung is fitted, and kept if

- the simulation explains more by Schwarz's criterion (1978), with as many samples as the colour of the residuals leaves,
- the new term is known to half of itself, or else leaving it out would move gain or time constant by more than their own
  standard deviation, which would claim to know more than the data tell,
- gain and time constant are still known to half of themselves, and the search has settled.

Then the tests look at what is left, until they ask for nothing, or for nothing that can be told.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.channels import Array
from servobench.doubts.base import about_data
from servobench.errors import NotIdentifiable, UsageError
from servobench.estimators.base import ESTIMATORS, Estimator, Fit
from servobench.estimators.covariance import andrews_lag, long_run
from servobench.estimators.disturbance import innovation_sd
from servobench.estimators.least_squares import Minimum
from servobench.estimators.output_error import best_minimum, fitted_roughly
from servobench.explanations.base import is_damaged, names_a_cause
from servobench.finding import Finding, info, warning
from servobench.measurement.dataset import Dataset
from servobench.missing_terms import shown_terms
from servobench.models.base import STRUCTURES, Structure
from servobench.models.nonlinear.grammar import with_term
from servobench.models.search import smoothed_speed, turns_both_ways
from servobench.score_test import ASKED, LIMIT, Shown
from servobench.validation import explains_the_colour
from servobench.winding import about_winding

_RUNGS = 5  # as many as there are
# What hides the others if it is large comes first; an arm may need both of the first two before either can be told.
_BY_TRIAL = ("gravity", "coulomb_gravity", "coulomb", "asymmetric", "load")
_REST = "rest-found"
_CHANCE = 0.05  # of the runs without a term, in which it seems likely enough to be worth a word
_WITH_WINDING = {
    "first_order": "second_order",
    "first_order_coulomb": "second_order_coulomb",
    "first_order_one_way": "second_order_one_way",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """The fit of the structure that was chosen, `findings` that say why, and what of terms the score tests have `shown` in it."""

    fit: Fit
    shown: tuple[Shown, ...] = ()
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rung:
    """A rung that was tried: its term, the fit with it, as it is and as it is allowed for, and why it can't be kept.

    `hidden` is what to say of one that can't be left out for certain, either.
    """

    term: str
    plain: Fit
    fit: Fit
    doubt: str
    hidden: Finding | None = None


def chosen(
    method: Estimator,
    data: Sequence[Dataset],
    structure: str,
    estimator: str,
    allow: Callable[[Fit], Fit],
) -> Choice:
    """Return the fit of the structure asked for, or of the one that the data need ("auto").

    `allow` makes of a fit one that allows for what disturbs the motor. Raises `NotIdentifiable` where the data can't support it,
    and `UsageError` where a structure and an estimator were named that can't go together.
    """
    if structure != "auto":
        _check_combination(method, STRUCTURES[structure], data, estimator)
        fit = allow(_fitted(method, STRUCTURES[structure], data))
        return Choice(fit=fit, shown=shown_terms(fit))
    return _climbed(method, data, *_base(method, data), allow)


def _check_combination(
    method: Estimator, structure: Structure, data: Sequence[Dataset], estimator: str
) -> None:
    """Raise `UsageError` where the estimator that was named can't work on the structure that was named."""
    hindrance = method.supports(structure, data) if estimator != "auto" else None
    if hindrance is not None:
        raise UsageError(hindrance.sentence)


def _base(method: Estimator, data: Sequence[Dataset]) -> tuple[Fit, tuple[Finding, ...]]:
    """The fit of the simplest structure for a motor that turned so, with Coulomb friction if that is needed, and why."""
    if not turns_both_ways(data):
        return _resting(method, data, _fitted(method, STRUCTURES["first_order_one_way"], data))
    frictionless = _fitted(method, STRUCTURES["first_order"], data)
    try:
        with_friction = _fitted(method, STRUCTURES["first_order_coulomb"], data)
    except NotIdentifiable:
        return frictionless, ()
    if _better(with_friction, frictionless):
        sentence = (
            f"Coulomb friction is needed: without it the simulation explains {frictionless.fit_percent:.1f} % of the output, "
            f"with it {with_friction.fit_percent:.1f} %, and the gain would be {frictionless['gain'].value:.4g} instead of "
            f"{with_friction['gain'].value:.4g}."
        )
        return with_friction, (info("friction-found", sentence, parameters=("coulomb_voltage",)),)
    if _moved(with_friction, frictionless):
        sentence = (
            "No Coulomb friction can be told from these data for certain, but it can't be left out either: without it the gain "
            f"would be {frictionless['gain'].value:.5g} instead of {with_friction['gain'].value:.5g}, and seem better "
            "known than it is."
        )
        return with_friction, (info("friction-possible", sentence, parameters=("coulomb_voltage",)),)
    sentence = "No Coulomb friction can be told from these data: the model without it explains them as well."
    return frictionless, (info("friction-not-found", sentence),)


def _resting(method: Estimator, data: Sequence[Dataset], one_way: Fit) -> tuple[Fit, tuple[Finding, ...]]:
    """The fit for a motor that turned one way: the simple one, or that of a shaft that friction holds where it also stood."""
    if explains_the_colour(one_way) or not _stands(data):
        return one_way, ()
    try:
        with_rest = _fitted(method, STRUCTURES["first_order_one_way_rest"], data)
    except NotIdentifiable:
        return one_way, ()
    if not with_rest.converged or not _better(with_rest, one_way):
        return one_way, ()
    sentence = (
        "The motor stands still in a part of the record, so the model has friction that holds the shaft: without it the "
        f"simulation explains {one_way.fit_percent:.2f} % of the output, with it {with_rest.fit_percent:.2f} %."
    )
    return with_rest, (info(_REST, sentence, parameters=("coulomb_voltage",)),)


def _stands(data: Sequence[Dataset]) -> bool:
    """Whether at least one sample in fifty was taken while the motor stood still."""
    speeds = [np.abs(smoothed_speed(record)) for record in data]
    still = np.concatenate([speed <= 1e-3 * speed.max() for speed in speeds])
    return bool(np.mean(still) > 0.02)


def _climbed(
    method: Estimator,
    data: Sequence[Dataset],
    base: Fit,
    findings: tuple[Finding, ...],
    allow: Callable[[Fit], Fit],
) -> Choice:
    """The base with a rung more for each term that the data ask for and can tell, and why there are no more."""
    plain, fit, refused = base, allow(base), dict[str, _Rung]()
    shown = shown_terms(fit)
    if any(finding.code == _REST for finding in findings):
        return Choice(fit=fit, shown=shown, findings=findings)  # nothing more can be told of its friction
    if _suspected(shown, fit) and _damaged(data, fit):
        return Choice(fit=fit, shown=shown, findings=findings)
    for _ in range(_RUNGS):
        terms = [t for t in _suspected(shown, fit) if t not in refused and _with(fit.structure, t)]
        asked = _asked(shown)
        tried = (_tried(method, data, plain, fit, term, term in asked, allow) for term in terms)
        kept = next((rung for rung in tried if not _noted(rung, refused)), None)
        if kept is None:
            break
        earlier = [f for f in findings if "coulomb" not in kept.term or f.code != "friction-not-found"]
        findings = (*earlier, _found(kept, plain, fit))
        plain, fit = kept.plain, kept.fit
        shown = shown_terms(fit)
    hidden = [rung.hidden for rung in refused.values() if rung.hidden]
    return Choice(fit=fit, shown=shown, findings=(*findings, _stopped(fit, shown, refused), *hidden))


def _damaged(data: Sequence[Dataset], fit: Fit) -> bool:
    """Whether something is wrong with the records themselves, to which a richer structure would only bend."""
    told = [finding for record in data for finding in record.findings]
    return names_a_cause([*told, *about_data(data)]) or is_damaged(data, fit.fit_percent)


def _with(structure: str, term: str) -> str | None:
    """The name of the structure with a term more, None where there is none: a rung of the ladder, or the winding's pole."""
    return _WITH_WINDING.get(structure) if term == "winding" else with_term(structure, term)


def _noted(rung: _Rung, refused: dict[str, _Rung]) -> bool:
    """Whether something speaks against a rung; it is noted in `refused`."""
    if rung.doubt:
        refused[rung.term] = rung
    return bool(rung.doubt)


def _suspected(shown: Sequence[Shown], fit: Fit) -> list[str]:
    """The rungs to try: those that the data ask for, and all where the fit leaves a colour that nothing explains.

    A score test knows of small terms only: where gravity is large, the model's angle is so wrong that a pull by it means nothing.
    """
    asked = _asked(shown)
    if not explains_the_colour(fit):
        first = [
            term for term in asked if term == "winding"
        ]  # two poles bend all else, and are fitted in no time
        return list(dict.fromkeys([*first, *_BY_TRIAL, *asked]))
    # Friction was looked for before gravity was known, and so in vain.
    return ["coulomb", *asked] if fit.structure == "first_order_gravity" else asked


def _asked(shown: Sequence[Shown]) -> list[str]:
    """The rungs that the data ask for, strongest first."""
    asked = [one for one in shown if _asks(one)]
    asked.sort(key=lambda one: -one.size)
    return list(dict.fromkeys(str(one.term.rung) for one in asked))


def _asks(one: Shown) -> bool:
    """Whether a score test calls for a rung: friction that falls with the speed or grows with the load, not the other way.

    Where its absence moves gain or time constant by more than their own standard deviation, a hint is enough to try it: a
    filter for a random torque takes a good part of what is missing for noise.
    """
    if one.term.rung is None or one.size <= ASKED:
        return False
    if one.term.rung in ("stribeck", "load") and one.amount[0] < 0:
        return False
    hint = one.term.rung != "winding" and one.moved > 1  # what a delay is made of is in the intervals already
    return one.size > one.term.limit or hint


def _tried(
    method: Estimator,
    data: Sequence[Dataset],
    plain: Fit,
    fit: Fit,
    term: str,
    asked: bool,
    allow: Callable[[Fit], Fit],
) -> _Rung:
    """The rung with a term, fitted, and what speaks against it; `asked` says that a score test calls for it."""
    structure = STRUCTURES[_with(fit.structure, term) or ""]
    if method.supports(structure, data) is not None:
        return _Rung(term=term, plain=plain, fit=fit, doubt=f"{fit.estimator} can't fit it")
    try:
        starts = (_embedded(plain, structure, data), *structure.guesses(data))
        nearest = best_minimum(structure, data, starts)
        if not _worth_it(nearest, data, plain):
            return _Rung(term=term, plain=plain, fit=fit, doubt="it explains no more")
        if method is ESTIMATORS["output_error"]:
            # Most rungs end here; the intervals near bounds, which nobody would see, take longer than all the rest.
            doubt = _early_doubt(term, asked, fitted_roughly(structure, data, nearest), plain, fit)
            if doubt:
                return _Rung(term=term, plain=plain, fit=fit, doubt=doubt)
        richer = method.fit(structure, data, (nearest.theta,))
        doubt = _early_doubt(term, asked, richer, plain, fit)
        if doubt:
            return _Rung(term=term, plain=plain, fit=fit, doubt=doubt)
        allowed = allow(richer)
    except NotIdentifiable as error:
        return _Rung(term=term, plain=plain, fit=fit, doubt=str(error))
    doubt, hidden = _doubt(term, asked, richer, allowed, fit), None
    if not doubt:
        doubt, hidden = _fed_back(term, allowed, fit)
    return _Rung(term=term, plain=richer, fit=allowed, doubt=doubt, hidden=hidden)


def _early_doubt(term: str, asked: bool, richer: Fit, plain: Fit, fit: Fit) -> str:
    """Why a rung can't be kept, as far as that is seen before allowing for what disturbs the motor; empty where it isn't."""
    doubt = _doubt(term, asked, richer, richer, fit)
    if not doubt and _at_the_edge(richer, plain):
        doubt = "it drives a parameter to the edge of what is possible"
    if not doubt and not explains_the_colour(richer):
        doubt = _doubt(term, asked, richer, _as_uncertain(richer, plain, fit), fit)
    return doubt


def _as_uncertain(richer: Fit, plain: Fit, fit: Fit) -> Fit:
    """A rung that explains the colour no better, as unsure as allowing for it has made the rung below: that takes no search.

    `plain` is the rung below as it is, `fit` as it is allowed for.
    """
    factors = [fit[n].sd / plain[n].sd for n in ("gain", "time_constant") if 0 < plain[n].sd < np.inf]
    return replace(richer, covariance=max([1.0, *factors]) ** 2 * richer.covariance)


def _worth_it(richer: Minimum, data: Sequence[Dataset], plain: Fit) -> bool:
    """Whether a rung explains more by Schwarz's criterion (1978), with as many samples as the colour of what is left is worth.

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


def _fed_back(term: str, allowed: Fit, fit: Fit) -> tuple[str, Finding | None]:
    """Why a rung can't be kept where a controller answers to a random torque, and what to say if it can't be left out, either.

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
    worth = _deviance(fit) - _deviance(allowed)
    needed = max(float(chdtri(more, 2 * ndtr(-LIMIT))), more * float(np.log(samples)))
    if worth > needed:
        return "", None
    doubt = (
        f"beside the random torque it explains little: a likelihood ratio of {worth:.2g}, limit {needed:.2g}"
    )
    chance = float(chdtri(more, _CHANCE))
    if worth <= chance or not _moved(allowed, fit):
        return doubt, None
    sentence = (
        f"This closed loop doesn't tell whether there is {_TERMS[term]}: with it the gain would be {allowed['gain'].value:.4g} "
        f"instead of {fit['gain'].value:.4g}. Chance alone seldom makes it look as likely (likelihood ratio {worth:.2g}; chance "
        f"exceeds {chance:.2g} once in 20 runs), but a random torque acts, to which the controller answers: record a longer run, "
        "larger steps, or one in open loop."
    )
    return doubt, warning("term-hidden", sentence, parameters=("gain", "time_constant"))


def _deviance(fit: Fit) -> float:
    """-2 ln of the likelihood of a fit's innovations, but for a constant: the sum of e²/s² + 2 ln s over the samples."""
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


def _doubt(term: str, asked: bool, richer: Fit, allowed: Fit, fit: Fit) -> str:
    """Why a rung that explains more can't be kept all the same; empty where it can.

    A term whose size isn't known is kept only where the data ask for it and its absence would move gain or time constant.
    """
    if not richer.converged:
        return "the search for it doesn't settle"
    told = about_winding(allowed)
    if told:
        return told[0].sentence
    if any(not allowed[n].sd < 0.5 * abs(allowed[n].value) for n in ("gain", "time_constant")):
        return "gain and time constant would not be known any more"
    value, sd = _amount(term, allowed)
    if not sd < 0.5 * value and not (asked and _moved(allowed, fit)):
        return f"its size can't be told from zero ({value:.2g} ± {1.959964 * sd:.1g})"
    return ""


_NAMES = {
    "coulomb": "coulomb_voltage",
    "load": "load_friction",
    "asymmetric": "drag_asymmetry",
    "winding": "electrical_time_constant",
}


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
    zero = {name for name in old if name in richer.model.names and richer[name].value == 0}
    return bool(at_edge[0] - at_edge[1] - zero)


def _amount(term: str, fit: Fit) -> tuple[float, float]:
    """How much of a term a fit has, and its standard deviation: of Stribeck friction the area u_s ω_s, which reversals tell."""
    names = fit.model.names
    value, slope = 0.0, np.zeros(len(names))
    if term == "stribeck":
        u, speed = (names.index(n) for n in ("stribeck_voltage", "stribeck_speed"))
        value = float(fit.model.theta[u] * fit.model.theta[speed])
        slope[u], slope[speed] = fit.model.theta[speed], fit.model.theta[u]
    elif term in ("gravity", "coulomb_gravity"):
        at = [names.index(n) for n in ("gravity_voltage_sine", "gravity_voltage_cosine")]
        value = float(np.hypot(*fit.model.theta[at]))
        slope[at] = fit.model.theta[at] / (value or 1.0)
    else:
        at_one = names.index(_NAMES[term])
        value = abs(float(fit.model.theta[at_one]))
        slope[at_one] = 1.0
    variance = float(slope @ fit.covariance @ slope)
    return value, float(np.sqrt(max(variance, 0.0))) if np.isfinite(variance) else np.inf


def _embedded(plain: Fit, structure: Structure, data: Sequence[Dataset]) -> Array:
    """The simpler fit as a start vector of a richer structure, with a little of what is new."""
    value = dict(zip(plain.model.names, plain.model.theta, strict=True))
    coulomb, offset = value.get("coulomb_voltage", 0.0), value.get("offset_voltage", 0.0)
    top = max(float(np.abs(smoothed_speed(record)).max()) for record in data)
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


_CODES = {
    "coulomb": "friction-found",
    "stribeck": "stribeck-found",
    "gravity": "gravity-found",
    "coulomb_gravity": "gravity-found",
    "asymmetric": "friction-asymmetric",
    "load": "load-friction-found",
    "winding": "winding-found",
}
_SAYS = {
    "coulomb": "Coulomb friction is needed",
    "stribeck": "Friction is larger near standstill than at speed (Stribeck)",
    "gravity": "Gravity pulls at the shaft, as at an arm or a pendulum",
    "coulomb_gravity": "Gravity pulls at the shaft, as at an arm or a pendulum, and Coulomb friction brakes it",
    "asymmetric": "Friction isn't the same in the two directions",
    "load": "Friction grows with the load that gravity puts on the shaft",
    "winding": "The current lags behind the voltage, as the winding's inductance makes it",
}


_TERMS = {
    "coulomb": "Coulomb friction",
    "stribeck": "friction that falls with the speed",
    "gravity": "gravity at an arm or a pendulum",
    "coulomb_gravity": "gravity beside Coulomb friction",
    "asymmetric": "friction that differs by direction",
    "load": "friction that grows with the load",
    "winding": "the winding's lag",
}


def _found(rung: _Rung, plain: Fit, fit: Fit) -> Finding:
    """The finding that a rung is kept: how large the term is, what it explains, and what the gain would be without it."""
    new = [n for n in rung.fit.model.names if n not in fit.model.names]
    sizes = ", ".join(f"{n} {_estimate(rung.fit, n)}" for n in new)
    sentence = f"{_SAYS[rung.term]}: {sizes}. {_what_for(rung, plain, fit)}"
    return info(_CODES[rung.term], sentence, parameters=tuple(new))


def _what_for(rung: _Rung, plain: Fit, fit: Fit) -> str:
    """What a rung is worth; two numbers that are printed alike would say nothing."""
    percents = [f"{one.fit_percent:.2f}" for one in (plain, rung.plain)]
    gains = [f"{one['gain'].value:.4g}" for one in (fit, rung.fit)]
    if percents[0] == percents[1] and gains[0] == gains[1]:
        left = 100 * (1 - rung.plain.residual_sd / plain.residual_sd)
        return f"That is small: with it {left:.2g} % less is left over, and the gain stays {gains[0]} to four digits."
    return (
        f"Without it the simulation explains {percents[0]} % of the output, with it {percents[1]} %, and the gain would be "
        f"{gains[0]} instead of {gains[1]}."
    )


def _estimate(fit: Fit, name: str) -> str:
    """A parameter with the half of its interval and its unit."""
    found = fit[name]
    unit = "" if found.unit == "1" else f" {found.unit}"
    return f"{found.value:.3g} ± {1.959964 * found.sd:.1g}{unit}"


def _stopped(fit: Fit, shown: Sequence[Shown], refused: dict[str, _Rung]) -> Finding:
    """The finding that says why no further rung was climbed: nothing asks for one, or what was tried can't be told."""
    sentence = f"The structure is {fit.structure}."
    strong = any(one.term.rung in refused and one.size > one.term.limit for one in shown)
    # A rung that was tried on a hint, and explained nothing, is no news.
    if refused and (strong or not explains_the_colour(fit)):
        reasons = "; ".join(f"{_TERMS[term]} ({rung.doubt.rstrip('.')})" for term, rung in refused.items())
        sentence += f" Something is left to explain, but it can't be told to be {reasons}."
    else:
        sentence += " No further term of friction or gravity is asked for by the data."
    return info("structure-chosen", sentence)


def _fitted(method: Estimator, structure: Structure, data: Sequence[Dataset]) -> Fit:
    """The fit, or `NotIdentifiable` with the estimator's reason why it can't be done."""
    hindrance = method.supports(structure, data)
    if hindrance is not None:
        raise NotIdentifiable(hindrance.sentence.rstrip("."))
    return method.fit(structure, data)


def _better(one: Fit, other: Fit) -> bool:
    """Whether a fit with one parameter more is worth it by Schwarz's criterion (1978)."""
    samples = sum(int(record.valid.sum()) for record in one.records)
    return bool(samples * np.log(other.residual_sd**2 / one.residual_sd**2) > np.log(samples))


def _moved(one: Fit, other: Fit) -> bool:
    """Whether the other fit's gain or time constant is out by more than its own standard deviation if the one is right.

    Then leaving a parameter out would claim to know more than the data tell.
    """
    return any(abs(one[n].value - other[n].value) > other[n].sd for n in ("gain", "time_constant"))

"""The sentences about a rung of the ladder: that it was added and why, or why there is no further one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.finding import Finding, info
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import change_text, with_unit
from servobench.core.rounding import plain as number
from servobench.identification.choice.structure_ladder.trial import TERMS, Rung, is_certain
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.chain_unknown import is_unknown
from servobench.identification.trust.validation import explains_the_colour
from servobench.identification.uncertainty.score_test import TermScore

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
    "gravity": "Gravity acts on the shaft, as on an arm or a pendulum",
    "coulomb_gravity": "Gravity acts on the shaft, as on an arm or a pendulum, and so does Coulomb friction",
    "asymmetric": "Friction differs between the two directions",
    "load": "Friction grows with gravity's load on the shaft",
    "winding": "A second lag is needed, such as that of the winding's inductance",
}
_MEASURED = "There is a second lag, that of the winding or of a filter on the speed"
"""In place of the winding's inductance where it isn't known how a speed was measured."""
_TURNS = 4.0 * np.pi  # rad: an arm or a pendulum seldom goes round twice
_EACH_TURN = (
    "A torque repeats with each turn of the shaft, as that of an eccentric load, an arm or a pendulum does"
)
_REPEATS = {"gravity": _EACH_TURN, "coulomb_gravity": f"{_EACH_TURN}, and there is Coulomb friction"}
"""In place of gravity where the shaft goes round."""


def rung_finding(rung: Rung, plain: Fit, fit: Fit) -> Finding:
    """Return the finding that a rung is kept: how large the term is, what it explains, and what the gain would be without it.

    `plain` is the fit below it as it is, `fit` as it is allowed for.
    """
    new = [n for n in rung.fit.model.names if n not in fit.model.names]
    sizes = ", ".join(
        f"{parameter_in_words(n, rung.fit.unit(n))} {_size(rung.fit, n)}" for n in new
    ) + _gains(rung)
    if not is_certain(rung.term, rung.fit):
        sentence = (
            f"The data don't show for certain whether there is {TERMS[rung.term]} ({sizes}), but leaving it out "
            f"would make the other intervals too narrow. {_benefit_text(rung, plain, fit)}"
        )
        return info("term-possible", sentence, parameters=tuple(new))
    sentence = f"{_statement(rung.term, fit)}: {sizes}. {_benefit_text(rung, plain, fit)}"
    return info(_CODES[rung.term], sentence, parameters=tuple(new))


def _statement(term: str, fit: Fit) -> str:
    """What a rung says of the motor, by what the records of a fit have of it."""
    if term == "winding" and any(is_unknown(each.data) for each in fit.records):
        return _MEASURED
    if "gravity" in term and all(np.ptp(each.data.y) > _TURNS for each in fit.records):
        return _REPEATS[term]
    return _SAYS[term]


def _benefit_text(rung: Rung, plain: Fit, fit: Fit) -> str:
    """The benefit of a rung, in numbers that differ when printed."""
    percents = [f"{one.fit_percent:.2f}" for one in (plain, rung.plain)]
    gains = [number(one.model["gain"]) for one in (fit, rung.fit)]
    if percents[0] == percents[1] and gains[0] == gains[1]:
        left = 100 * (1 - rung.plain.residual_sd / plain.residual_sd)
        return (
            f"The effect is small: the residual falls by {left:.2g} %, and the gain stays {gains[0]} to four "
            "digits."
        )
    return (
        f"Without it the simulation explains {percents[0]} % of the output, with it {percents[1]} %, and the gain would be "
        f"{change_text(fit.model['gain'], rung.fit.model['gain'])}."
    )


def _gains(rung: Rung) -> str:
    """The gains K/(1 + K a) forward and K/(1 - K a) backward where drag differs by a; empty for another term."""
    if rung.term != "asymmetric":
        return ""
    gain, drag = rung.fit.model["gain"], rung.fit.model["drag_asymmetry"]
    forward, backward = (number(gain / (1.0 + way * gain * drag)) for way in (1.0, -1.0))
    return f", so a gain of {forward} {rung.fit.unit('gain')} forward and {backward} backward"


def _size(fit: Fit, name: str) -> str:
    """A parameter with its unit; its interval is left to the table, as what is allowed for later is part of it."""
    unit = fit.unit(name)
    return with_unit(float(fit.model[name]), "" if unit == "1" else unit, 2)


def stop_finding(fit: Fit, shown: Sequence[TermScore], refused: dict[str, Rung]) -> Finding:
    """Return the finding that says why no further rung was climbed: nothing asks for one, or what was tried can't be told."""
    sentence = f"The structure is {fit.structure}."
    strong = any(one.term.rung in refused and one.size > one.term.limit for one in shown)
    # A rung that was tried on a hint, and explained nothing, is no news.
    if refused and (strong or not explains_the_colour(fit)):
        reasons = "; ".join(f"{TERMS[term]} ({rung.doubt.rstrip('.')})" for term, rung in refused.items())
        sentence += f" Something remains unexplained. Tried and left out: {reasons}."
    else:
        sentence += " The data show no further friction or gravity."
    return info("structure-chosen", sentence)

"""The meaning of the one lost voltage if the motor only turned one way."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.level import single_level
from servobench.identification.models.motion import directions, turns_both_ways
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.uncertainty.friction_near_rest import ExcessFriction

_HARDLY = 0.05  # of the largest speed
_BEYOND = 5.0  # times the largest input: no friction, and no offset of an amplifier
_RARE = 2.0  # % of the samples: a start speed that is gone within a sample or two may be any number, and is no turning


def hardly_turns_back(fit: Fit) -> bool:
    """Return whether the motor that was fitted turns one way but for a few percent of its speed: noise may turn back as much.

    If a motor turns one way, friction can't be distinguished from an offset; where a search ends is chance.
    """
    structure = fit.model.structure
    if not isinstance(structure, ExcessFriction):
        return False
    vectors = [np.concatenate([fit.model.theta, record.nuisance]) for record in fit.records]
    speed = np.concatenate([structure.speed(v, r.data) for v, r in zip(vectors, fit.records, strict=True)])
    slowest, fastest = np.percentile(speed, (_RARE, 100.0 - _RARE))
    back, forth = sorted((float(-slowest), float(fastest)))
    return back < _HARDLY * forth


def _one_way(fit: Fit) -> list[Finding]:
    """The meaning of the one lost voltage if the motor only turned one way."""
    if fit.structure not in ("first_order_one_way", "first_order_one_way_rest"):
        return []
    if turns_both_ways([record.data for record in fit.records]) and not hardly_turns_back(fit):
        sentence = (
            f"The structure {fit.structure} is for a motor that turns one way, but this one turns both ways: its friction "
            "changes sign, that of the model doesn't. Use `structure=first_order_coulomb`, whose friction does."
        )
        return [
            warning("structure-reverses", sentence, parameters=("gain", "time_constant", "coulomb_voltage"))
        ]
    estimate = fit["coulomb_voltage"]
    name = parameter_in_words("coulomb_voltage", estimate.unit)
    together = info(
        "friction-and-offset-together",
        f"The motor turned one way only, so Coulomb friction and an offset can't be separated: the {name} is their "
        "sum. Let it turn both ways.",
        parameters=("coulomb_voltage",),
    )
    if input_hardly_matters(fit):
        sentence = (
            "In this model the input has next to no part in the motion: the record shows how a speed settles by itself, and any "
            "bend of the characteristic looks like that. Record steps between several levels, each until the speed settles."
        )
        return [together, warning("input-hardly-matters", sentence, parameters=("gain", "time_constant"))]
    constant = _of_constant(fit, name)
    if abs(estimate.value) > 3 * estimate.sd:
        return [together, constant]
    low, high = estimate.interval
    if low <= 0.0 <= high or constant.code != "offset-negative":
        return [together]
    sentence = (
        f"The {name} comes out below zero, {estimate.value:.3g} {estimate.unit}, which friction can't be. Chance does that once "
        "in forty times; otherwise the motor isn't linear over these levels, or the input has an offset."
    )
    return [together, info("offset-negative", sentence, parameters=constant.parameters)]


def _of_constant(fit: Fit, name: str) -> Finding:
    """The finding on a constant that is known to be one, under its `name` in words: whether it brakes or drives the motor."""
    estimate, parameters = fit["coulomb_voltage"], ("coulomb_voltage", "gain")
    # The motor's equation has -K u_c, which brakes where it is against ω: K u_c ω > 0.
    turns = float(np.sign(np.sum(np.concatenate([directions(record.data) for record in fit.records]))))
    is_flag = fit.records[0].data.input_unit == "1"  # what it switches is unknown
    brakes = fit.structure == "first_order_one_way_rest"  # as it holds the shaft, whichever way that turns
    helps = estimate.value * fit["gain"].value * turns < 0 and not brakes
    if helps and is_flag:
        sentence = (
            f"The motor turns as if the input were larger by {-estimate.value * turns:.3g}: zero "
            "input isn't zero volts, and the gain holds for these levels only."
        )
        return info("offset-found", sentence, parameters=parameters)
    if helps:
        sentence = (
            f"The {name} comes out with the wrong sign, {estimate.value:.3g} {estimate.unit}: "
            "friction never drives. The motor isn't linear over these levels (it may saturate, or drag may grow faster than the "
            "speed, as a fan's), or the input has an offset; the gain holds for these levels only."
        )
        return warning("offset-negative", sentence, parameters=parameters)
    sign = " It is below zero because the input was." if estimate.value < 0.0 else ""
    sentence = (
        f"{with_unit(abs(estimate.value), estimate.unit)} of the input is lost at the speeds of this record; a model without "
        f"this offset would get the gain wrong. A shaft that stands may take more to set off.{sign}"
    )
    return info("offset-found", sentence, parameters=parameters)


def input_hardly_matters(fit: Fit) -> bool:
    """Return whether a constant drives the model far more than any of several inputs does, of which it may do without."""
    gain = fit["gain"]
    data = [record.data for record in fit.records]
    largest = max(float(np.abs(record.u).max(initial=0.0)) for record in data)
    far = abs(fit.model["coulomb_voltage"]) > _BEYOND * largest
    return far and not 2 * gain.sd < abs(gain.value) and single_level(data) is None


DOUBTS.member("one_way")(
    Doubt(
        codes=(
            "structure-reverses",
            "friction-and-offset-together",
            "offset-negative",
            "offset-found",
            "input-hardly-matters",
        ),
        about_fit=_one_way,
    )
)

"""A motor that only moved at one level of the input: gain and friction can't be separated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.finding import Finding, info
from servobench.core.rounding import plain
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.models.level import single_level
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.chain_unknown import is_unknown
from servobench.identification.uncertainty.identifiability import drive_level, sense_of_friction
from servobench.recordings.measurement.dataset import Dataset

_ANY_SPLIT = 3.0  # times its value: the standard deviation of a gain that nothing tells
_ANY = "the motor moved under one level of the input only: every gain, with a friction to match, gives the same speed"
_HIDDEN = 0.1  # of the gain: the standard deviation, as friction takes a tenth of a usual input
_UNSEEN = "beside one level the motor only coasted, and the unknown lag of the measurement hides where friction stopped it"
_OFF = 0.1  # of the largest input
_FRICTION = ("coulomb_voltage", "coulomb_voltage_forward", "coulomb_voltage_backward", "offset_voltage")


def _single_level(records: Sequence[Dataset]) -> list[Finding]:
    """Whether one level moved the motor: then only K (u - u_c), the speed that it leads to, is known, and not its two factors."""
    level = single_level(records)
    if level is None:
        return []
    unit = "" if records[0].input_unit == "1" else f" {records[0].input_unit}"
    return [
        info(
            "single-level",
            f"The motor moved under one level of the input only, {plain(level, 3)}{unit}, so the data show what it does at this "
            "level, but can't separate gain from friction. Add a second level; coasting counts as one only if the driver brakes "
            "at zero.",
            parameters=("gain", "coulomb_voltage"),
        )
    ]


def widen_for_gain_friction_split(fit: Fit) -> Fit:
    """Return the fit with a budget line for another split of the speed K (u - u_c) between the two, if one level drove the motor.

    A shaft at rest without an input says nothing about friction, whatever the model infers there, and one that coasts to rest
    behind a lag of the sensor hides a good part of it.
    """
    friction = next((name for name in _FRICTION if name in fit.model.names), "")
    if not friction or "gain" not in fit.model.names:
        return fit
    if single_level([record.data for record in fit.records]) is not None:
        return fit.widen(_split(fit, friction, "one level", _ANY_SPLIT, _ANY))
    known = fit.sd("gain") / abs(fit.model["gain"]) if fit.model["gain"] else np.inf
    if known < _HIDDEN and _coasts_unseen(fit, friction):
        lacking = float(np.sqrt(_HIDDEN**2 - known**2))
        return fit.widen(_split(fit, friction, "friction behind the sensor", lacking, _UNSEEN))
    return fit


def _split(fit: Fit, friction: str, source: str, size: float, reason: str) -> Contribution:
    """The line for gains that are off by a part `size` (one standard deviation), with a friction to match."""
    gain, level = fit.model["gain"], drive_level(fit)
    split = np.zeros(len(fit.model.names))
    split[fit.model.names.index("gain")] = gain
    split[fit.model.names.index(friction)] = sense_of_friction(fit, level) * level - fit.model[friction]
    return Contribution(source=source, covariance=size**2 * np.outer(split, split), reason=reason)


def _coasts_unseen(fit: Fit, friction: str) -> bool:
    """Whether beside one level there is only a coast that shows no friction, through a measurement that nobody has named.

    Friction stops a shaft, and a filter on its speed goes on: the way to rest looks as it does without friction.
    """
    if not all(is_unknown(record.data) for record in fit.records) or fit.sd(friction) < 0.5 * abs(
        fit.model[friction]
    ):
        return False
    u = np.concatenate([record.data.u for record in fit.records])
    driven = u[np.abs(u) > _OFF * np.abs(u).max()]
    return len(driven) < len(u) and float(np.ptp(driven)) <= _OFF * float(np.abs(u).max())


def widen_for_single_level(fit: Fit) -> Fit:
    """Return the fit, with gain and friction unknown if the motor only moved at one level of the input.

    Every pair with the same K (u - u_c) gives the same motion, so each of the two may have any value. The time constant and the
    delay are known from the shape of that motion, and stay as they are.
    """
    names = fit.model.names
    together = [names.index(name) for name in ("gain", *_FRICTION) if name in names]
    if "gain" not in names or len(together) < 2:
        return fit
    doubts = _single_level([record.data for record in fit.records])
    if not doubts:
        return fit
    covariance = fit.covariance.copy()
    covariance[together, :] = 0.0
    covariance[:, together] = 0.0
    covariance[together, together] = np.inf
    intervals = {name: ends for name, ends in fit.intervals.items() if names.index(name) not in together}
    return replace(fit, covariance=covariance, intervals=intervals, findings=(*fit.findings, *doubts))


DOUBTS.member("single_level")(Doubt(codes=("single-level",), about_data=_single_level))

"""Large inputs that act less than they should: an amplifier, a supply or a controller's limit clips what was commanded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.core.rounding import plain
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import Regression

_KNEES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95)
_BELOW = (0.05, 0.95)  # of a limit: inputs there act in full and show by how much less those beyond it act
_LESS = 0.8  # of the misfit is left if inputs beyond the limit act at all
_NEAR = 1.2  # times a limit: without inputs that are as near, the limit itself wasn't seen
_LEAST = 0.1  # of the effect below: less is none
_LATE = 0.8  # of the largest input: a bend beyond that leaves a gain as it is for most inputs
_AT = 0.8  # of a limit: inputs that come near to it
_HALF = 0.5  # of the growth of inputs beyond a limit, by which no speed grows there
_FEW = 5  # samples near a limit, or beyond it
_SEEN = 0.01  # of the samples, at least, have such an input


def _gain_falls(case: Case) -> CauseFit | None:
    """The best limit at which the input is clipped; None where no limit would show."""
    largest = max(float(np.abs(each.u).max()) for each in case.motions)
    tried = [
        (case.with_input(lambda m, limit=limit: np.clip(m.u, -limit, limit)), limit)  # type: ignore[misc]
        for limit in (part * largest for part in _KNEES)
        if any(_shows_a_limit(each.u, limit) for each in case.motions)
    ]
    if not tried:
        return None
    clipped, limit = min(tried, key=lambda each: each[0].misfit)
    bent, bend = min(((_with_bend(case, at), at) for _, at in tried), key=lambda each: each[0].misfit)
    slope = float(bent.coefficients[-1] / (bent.coefficients[1] or 1.0))
    if not (bent.misfit < _LESS * clipped.misfit and _LEAST < slope < 1.0):
        bend, slope = limit, 0.0
    if slope == 0.0 and _is_faster_beyond(case, bend):
        return None
    return CauseFit(
        finding=warning("gain-falls", _sentence(case, bend, slope), parameters=("gain",)),
        misfit=clipped.misfit,
        chosen=1,
        change=_change(bend / largest, slope),
        remedy=lambda data: replace(data, u=_bent(data.u, bend, slope), reference=None),
    )


def _is_faster_beyond(case: Case, limit: float) -> bool:
    """Whether the speed grows beyond a limit by half as much as the input does, and more: no limit lets it."""
    u = np.abs(np.concatenate([each.data.input_at_output for each in case.motions]))
    speed = np.abs(np.concatenate([smooth_speed(each.data) for each in case.motions]))
    near, beyond = (u > _AT * limit) & (u <= limit), u > limit
    if min(near.sum(), beyond.sum()) < _FEW:
        return False
    slow, fast = (float(np.percentile(speed[part], 95)) for part in (near, beyond))
    return fast > (1.0 + _HALF * (float(np.percentile(u[beyond], 95)) / limit - 1.0)) * slow


def _change(bend: float, slope: float) -> float:
    """The part of a fit's gain by which that below a `bend` exceeds it, or that beyond falls short of it: the larger one.

    The bend is a part of the largest input, the `slope` the gain beyond it, as a part of that below. A fit goes by the largest
    input, and has the mean gain up to there. Beyond a bend near the end there is hardly an input that the gain is used for.
    """
    fitted = bend + slope * (1.0 - bend)
    below = 1.0 / fitted - 1.0
    return below if bend > _LATE else max(below, 1.0 - slope / fitted)


def _with_bend(case: Case, limit: float) -> Regression:
    """The equation in which inputs beyond a limit act by another part than those below: the last coefficient is theirs."""
    beyond = [m.filter_through_chain(m.u - np.clip(m.u, -limit, limit)) for m in case.motions]
    return case.with_input(lambda m: np.clip(m.u, -limit, limit), beyond)


def _bent(u: Array, limit: float, slope: float) -> Array:
    """An input u (N,) of which what is beyond a limit counts by a `slope` below 1."""
    return np.asarray(slope * u + (1.0 - slope) * np.clip(u, -limit, limit), dtype=np.float64)


def _sentence(case: Case, limit: float, slope: float) -> str:
    unit = case.motions[0].data.input_unit
    where = f"Inputs beyond about {plain(limit, 2)} {unit}"
    if slope == 0.0:
        least = _least_beyond(case, limit)
        acts = (
            f"{where} have no further effect"
            if least < _NEAR * limit
            else f"Inputs of {plain(least, 3)} {unit}{_and_more(case, least)} act like about {plain(limit, 2)} {unit}"
        )
        return (
            f"{acts}: the amplifier, the supply or the controller limits the voltage. Record the "
            "voltage that was applied, or stay below that level."
        )
    return (
        f"{where} act only {plain(100 * slope, 1)} % as much as those below: the amplifier, the supply or the motor's load "
        "bends the characteristic. Record the voltage that was applied, or identify each range of the input by itself."
    )


def _and_more(case: Case, least: float) -> str:
    """The words for larger inputs than that, empty where there are none."""
    return " and more" if any(float(np.abs(each.u).max()) > least for each in case.motions) else ""


def _least_beyond(case: Case, limit: float) -> float:
    """The smallest input, without its sign, that is beyond a limit."""
    inputs = np.abs(np.concatenate([each.u for each in case.motions]))
    return float(np.min(inputs[inputs > limit], initial=float(inputs.max())))


def _shows_a_limit(u: Array, limit: float) -> bool:
    """Whether an input u (N,) is below a limit often enough: one level and its noise, clipped, is one level without noise."""
    low, high = (part * limit for part in _BELOW)
    return bool(np.mean((np.abs(u) > low) & (np.abs(u) < high)) >= _SEEN)


EXPLANATIONS.member("gain_falls")(_gain_falls)

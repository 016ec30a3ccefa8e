"""The answer of a record for each parameter: its value, a combination that it is part of, a bound, or nothing.

A record may know a gain to 1 % and nothing of a time constant. Two parameters that nothing tells apart are often well known
together: time constant and delay as the lag behind a slow input, gain and friction as the speed that a voltage leads to, gain
and time constant as the acceleration that a voltage begins with, all three of gain, friction and time constant as that under
one level.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from servobench.core.channels import Array
from servobench.core.estimate import Estimate
from servobench.core.rounding import TWO_SIDED, plain
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.delay_prior import is_only_a_fit
from servobench.identification.models.level import single_level
from servobench.identification.models.steady import SETTLED, longest_time_constant, speeds_by_level

_SAMPLED = 10.0  # samples in a time constant: more wouldn't tell it any better
_MOSTLY = 0.5  # of a variance
_KNOWN = 0.5  # of the value: half-width of a 95 % interval up to which a parameter is known
_TOGETHER = 0.5  # the same of a combination
_BETTER = 3.0  # times: a combination known so much better is what the record tells
_ROUGH = 0.2  # of the value: a parameter known better than that is stated by itself all the same
_LEVELS = 2  # that a motor settled at, for the speeds to show that they follow the input
_WAY = np.array([0.05, 0.25, 0.5, 0.75, 0.95])  # the middle one is the usual level
_FAR = 10.0  # times the value
_SMALL = 0.05  # of the largest input, or of the lag: what is known to lie below that is known
_BY_DIRECTION = ("coulomb_voltage_forward", "coulomb_voltage_backward")
_FRICTION = ("coulomb_voltage", *_BY_DIRECTION, "offset_voltage")
_GRAVITY = ("gravity_voltage_sine", "gravity_voltage_cosine")


class State(StrEnum):
    """How far a parameter is known."""

    KNOWN = "known"
    COMBINATION = "combination"
    BOUNDED = "bounded"
    UNKNOWN = "unknown"


@dataclass(frozen=True, kw_only=True)
class Combination:
    """A known combination of several parameters: `parameters`, its `meaning` in words, and its 95 % interval.

    `input_level` in `input_unit` is the level of the input that it holds at, None where it holds at any.
    """

    name: str
    """`lag`, `speed_at_level`, `acceleration` or `acceleration_at_level`."""
    meaning: str
    parameters: tuple[str, ...]
    estimate: Estimate
    """Its value with the interval."""
    input_level: float | None = None
    input_unit: str = ""


@dataclass(frozen=True, kw_only=True)
class ParameterStatus:
    """A record's answer for one parameter.

    `combination` is the name of the combination that it is known in, `remedy` what would tell it; empty where it is known.
    `mirrored` says that a bound is the lower end: what a motor that turns backwards loses is below zero.
    """

    name: str
    state: State
    """Known, in a combination only, bounded, or unknown."""
    estimate: Estimate
    """The fit's estimate, whatever it is worth."""
    combination: str = ""
    remedy: str = ""
    mirrored: bool = False


def parameter_statuses(fit: Fit, names: Sequence[str] | None = None) -> dict[str, ParameterStatus]:
    """Return what a fit tells of each of its parameters, or of those with certain `names`, by name.

    Of the intervals near a bound, each of which takes a search, only those are looked for on which an answer depends.
    """
    wanted = fit.model.names if names is None else names
    known = {each.name: each for each in combinations(fit)}
    gains = [name for name in ("gain", "loop_gain") if name in fit.model.names]
    statuses = {name: _status(fit, name, fit[name], known) for name in dict.fromkeys((*wanted, *gains))}
    if any(may_be_zero(statuses[name]) for name in gains):
        statuses = {
            name: replace(each, state=State.UNKNOWN, remedy=_remedy(name, fit))
            for name, each in statuses.items()
        }
    return {name: statuses[name] for name in wanted}


def combinations(fit: Fit) -> tuple[Combination, ...]:
    """Return the combinations of parameters that are known where not all of their parts are, in the order of `answers`."""
    candidates = [
        each
        for each in (make(fit) for make in (_lag, _drive, _acceleration, _acceleration_at_level))
        if each is not None and _relative(each.estimate) <= _TOGETHER and _tells_more(each, fit)
    ]
    vague = "gain" in fit.model.names and _relative(fit["gain"]) > _KNOWN
    if vague and not any("gain" in each.parameters for each in candidates):
        settled = _largest_settled_speed(fit)
        candidates += [] if settled is None else [settled]
    # The acceleration under one level follows from either of the others.
    elsewhere = any(each.name in ("acceleration", "speed_at_level") for each in candidates)
    return tuple(each for each in candidates if not (elsewhere and each.name == "acceleration_at_level"))


def _tells_more(whole: Combination, fit: Fit) -> bool:
    """Whether a combination is known much better than the first of its parts, which isn't known well.

    A sum that is known less well than another of its parts says nothing beyond that.
    """
    first, *others = whole.parameters
    if not _relative(fit[first]) > max(_ROUGH, _BETTER * _relative(whole.estimate)):
        return False
    parts = (fit[name] for name in others)
    return not any(
        is_known(part) and part.unit == whole.estimate.unit and part.half_width < whole.estimate.half_width
        for part in parts
    )


def _status(fit: Fit, name: str, estimate: Estimate, known: Mapping[str, Combination]) -> ParameterStatus:
    among = next((each.name for each in known.values() if name in each.parameters), "")
    if among and not _is_known(fit, name, estimate, among):
        return ParameterStatus(
            name=name,
            state=State.COMBINATION,
            estimate=estimate,
            combination=among,
            remedy=_remedy(name, fit),
        )
    if _is_known(fit, name, estimate, among):
        return ParameterStatus(name=name, state=State.KNOWN, estimate=estimate)
    low, high = estimate.interval
    mirrored = name in _FRICTION and drive_level(fit) * sense_of_friction(fit, drive_level(fit)) < 0
    end = -low if mirrored else high
    bounded = np.isfinite([low, high]).all() and 0 < end <= _largest(fit, name)
    state = State.BOUNDED if bounded else State.UNKNOWN
    if bounded and name == "time_constant":
        settles_within = longest_time_constant([record.data for record in fit.records])
        estimate = replace(estimate, interval=(low, min(high, max(settles_within, estimate.value))))
    return ParameterStatus(
        name=name, state=state, estimate=estimate, remedy=_remedy(name, fit), mirrored=mirrored
    )


def is_known(estimate: Estimate) -> bool:
    """Return whether an interval is narrow enough for its parameter to be known by itself."""
    return _relative(estimate) <= _KNOWN


def may_be_zero(gain: ParameterStatus) -> bool:
    """Return whether the input may not move the motor at all: a lag or a friction of that input then means nothing."""
    low, high = gain.estimate.interval
    return gain.state is State.UNKNOWN and -np.inf < low <= 0.0 <= high < np.inf


def _is_known(fit: Fit, name: str, estimate: Estimate, among: str) -> bool:
    if not np.isfinite(estimate.sd):
        return False
    if name in ("gain", "time_constant", "loop_gain"):
        return _relative(estimate) <= _ROUGH if among else is_known(estimate)
    if name == "delay" and _is_no_delay(fit, estimate):
        return False
    if name == "delay" or name in _FRICTION + _GRAVITY:
        small = 0.0 if _hangs_on_lag(fit, name) else _SMALL * _size(fit, name)
        return estimate.half_width <= max(_KNOWN * abs(estimate.value), small)
    return True


def _hangs_on_lag(fit: Fit, name: str) -> bool:
    """Whether a friction is mostly as uncertain as it is because nobody knows the time constant, as behind a ramp."""
    if name not in _FRICTION or "time_constant" not in fit.model.names or is_known(fit["time_constant"]):
        return False
    n, lag = fit.model.names.index(name), fit.model.names.index("time_constant")
    own, its = fit.covariance[n, n], fit.covariance[lag, lag]
    if not (0 < own < np.inf and 0 < its < np.inf):
        return False
    return bool(abs(fit.covariance[n, lag]) / np.sqrt(own) / np.sqrt(its) > np.sqrt(_MOSTLY))


def _is_no_delay(fit: Fit, estimate: Estimate) -> bool:
    """Whether a delay isn't known although it may have a short interval.

    One below zero says how far apart columns are, which hides what the motor has; one that a prior let stand far from what is
    usual is what happens to fit best.
    """
    longest = max(record.data.duration for record in fit.records)
    return estimate.half_width > longest or estimate.interval[1] < 0.0 or is_only_a_fit(fit)


def _largest(fit: Fit, name: str) -> float:
    """Up to where an upper end says something."""
    longest = max(record.data.duration for record in fit.records)
    if name == "time_constant":
        value, step = abs(fit.model[name]), max(record.data.sample_time for record in fit.records)
        # For an unresolved one only the upper end is stated; a resolved one that may be ten times as long isn't bounded.
        return min(longest, _FAR * value) if value > step else longest
    if name == "delay":
        return min(_size(fit, name), longest)
    return _size(fit, name) if name in _FRICTION else -np.inf


def _size(fit: Fit, name: str) -> float:
    """The scale of a parameter: the motor's lag, or the largest input."""
    if name == "delay":
        return (
            float(fit.model["time_constant"] + abs(fit.model["delay"]))
            if "time_constant" in fit.model.names
            else 0.0
        )
    return max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records)


def _relative(estimate: Estimate) -> float:
    half = estimate.half_width
    return half / abs(estimate.value) if np.isfinite(half) and estimate.value else np.inf


def _remedy(name: str, fit: Fit) -> str:
    """What to record to learn a parameter, beyond what the records have: nobody is told to do what was done."""
    records = [record.data for record in fit.records]
    if name in ("time_constant", "delay"):
        step = max(record.sample_time for record in records)
        resolved = "time_constant" in fit.model.names and fit.model["time_constant"] > _SAMPLED * step
        several = "several steps from rest, each until the speed settles"
        return several if resolved else "steps that are sampled at least ten times in a time constant"
    if name == "gain" or name in _FRICTION:
        one = single_level(records) is not None
        several = "several levels of the input in one direction, each until the speed settles"
        return "a second level of the input or coasting" if one else several
    return "an input that changes often, for longer"


def _lag(fit: Fit) -> Combination | None:
    if not {"time_constant", "delay"} <= set(fit.model.names):
        return None
    return _combine(
        fit,
        "lag",
        "time constant + delay",
        ("time_constant", "delay"),
        "s",
        lambda value: (value["time_constant"] + value["delay"], {"time_constant": 1.0, "delay": 1.0}),
    )


def _drive(fit: Fit) -> Combination | None:
    """The speed that the level leads to which the motor moved under."""
    lost = tuple(name for name in _FRICTION if name in fit.model.names)
    by_direction = any(name in lost for name in _BY_DIRECTION)
    if "gain" not in fit.model.names or not lost or by_direction:
        return None
    usual = _speed_at(fit, drive_level(fit), lost)
    if _relative(usual.estimate) <= _TOGETHER:
        return usual
    others = (_speed_at(fit, float(level), lost) for level in _levels_of_motion(fit))
    return min(others, key=lambda each: _relative(each.estimate))


def _speed_at(fit: Fit, level: float, lost: Sequence[str]) -> Combination:
    """The speed that a level of the input leads to, by the model."""
    senses = {name: 1.0 if name == "offset_voltage" else sense_of_friction(fit, level) for name in lost}

    def speed(value: Mapping[str, float]) -> tuple[float, dict[str, float]]:
        left = level - sum(sense * value[name] for name, sense in senses.items())
        return value["gain"] * left, {"gain": left, **{n: -value["gain"] * s for n, s in senses.items()}}

    return _at_level(fit, level, _estimate(fit, _speed_unit(fit), speed))


def _largest_settled_speed(fit: Fit) -> Combination | None:
    """The largest speed that the motor settled at, read off the records, where speeds under several levels grow with these.

    It needs no model, and says what is known where none holds for the whole record.
    """
    speeds = speeds_by_level([record.data for record in fit.records])
    values = np.array(list(speeds.values()))
    error = SETTLED * float(np.abs(values).max(initial=0.0))
    steps = np.diff(values)
    if len(values) < _LEVELS or not (np.all(steps > error) or np.all(steps < -error)):
        return None
    level, speed = max(speeds.items(), key=lambda each: abs(each[1]))
    interval = (speed - error, speed + error)
    known = Estimate(value=speed, sd=error / TWO_SIDED, interval=interval, level=0.95, unit=_speed_unit(fit))
    return _at_level(fit, level, known)


def _at_level(fit: Fit, level: float, estimate: Estimate) -> Combination:
    """The combination that is the speed at a level of the input."""
    unit = fit.records[0].data.input_unit
    return Combination(
        name="speed_at_level",
        meaning=f"speed at {_level_in_words(level, unit)}",
        parameters=("gain", *(name for name in _FRICTION if name in fit.model.names)),
        estimate=estimate,
        input_level=level,
        input_unit=unit,
    )


def _speed_unit(fit: Fit) -> str:
    return f"{fit.records[0].data.position_unit}/s"


def drive_level(fit: Fit) -> float:
    """Return the input under which the motor moved for most of the way."""
    levels = _levels_of_motion(fit)
    return float(levels[len(levels) // 2])


def _levels_of_motion(fit: Fit) -> Array:
    """The levels of the input (L,), ascending, up to which the motor moved for the parts `_WAY` of its way."""
    way = u = np.zeros(0)
    for record in fit.records:
        data = record.data
        speed = np.gradient(record.prediction) if data.kind == "position" else record.prediction
        way, u = np.concatenate([way, np.abs(speed)]), np.concatenate([u, data.input_at_output])
    order = np.argsort(u)
    gone = np.cumsum(way[order])
    return u[order][np.searchsorted(gone, gone[-1] * _WAY)] if gone[-1] > 0 else np.repeat(u[:1], len(_WAY))


def _acceleration(fit: Fit) -> Combination | None:
    if not {"gain", "time_constant"} <= set(fit.model.names):
        return None
    data = fit.records[0].data

    def slope(value: Mapping[str, float]) -> tuple[float, dict[str, float]]:
        k, tau = value["gain"], value["time_constant"]
        return k / tau, {"gain": 1 / tau, "time_constant": -k / tau**2}

    unit = f"{data.position_unit}/(s²·{data.input_unit})"
    return _combine(fit, "acceleration", "gain / time constant", ("gain", "time_constant"), unit, slope)


def _acceleration_at_level(fit: Fit) -> Combination | None:
    """That with which a level of the input sets a motor off whose record ends long before it has its speed."""
    lost = [name for name in _FRICTION if name in fit.model.names]
    if not {"gain", "time_constant"} <= set(fit.model.names) or len(lost) != 1:
        return None
    data, level = fit.records[0].data, drive_level(fit)
    sense = sense_of_friction(fit, level)

    def slope(value: Mapping[str, float]) -> tuple[float, dict[str, float]]:
        k, tau, left = value["gain"], value["time_constant"], level - value[lost[0]] * sense
        return k * left / tau, {
            "gain": left / tau,
            lost[0]: -k * sense / tau,
            "time_constant": -k * left / tau**2,
        }

    meaning = f"acceleration at {_level_in_words(level, data.input_unit)}"
    parameters = ("gain", lost[0], "time_constant")
    combination = _combine(
        fit, "acceleration_at_level", meaning, parameters, f"{data.position_unit}/s²", slope
    )
    return replace(combination, input_level=level, input_unit=data.input_unit)


def _level_in_words(level: float, unit: str) -> str:
    return plain(level) if unit == "1" else f"{plain(level)} {unit}"


def sense_of_friction(fit: Fit, level: float) -> float:
    """Return the sign of what friction takes of a level: where it doesn't brake but is a constant, the parameter has its own."""
    return float(np.sign(level)) if fit.model.structure.friction else 1.0


def _combine(
    fit: Fit,
    name: str,
    meaning: str,
    parameters: tuple[str, ...],
    unit: str,
    function: Callable[[Mapping[str, float]], tuple[float, dict[str, float]]],
) -> Combination:
    return Combination(
        name=name, meaning=meaning, parameters=parameters, estimate=_estimate(fit, unit, function)
    )


def _estimate(
    fit: Fit, unit: str, function: Callable[[Mapping[str, float]], tuple[float, dict[str, float]]]
) -> Estimate:
    """The value of a function of the parameters, which returns its slopes as well, with the interval that they give it."""
    value, slopes = function(dict(zip(fit.model.names, map(float, fit.model.theta), strict=True)))
    gradient = np.array([slopes.get(each, 0.0) for each in fit.model.names])
    sd = float(np.sqrt(_quadratic(gradient, fit.covariance)))
    half = TWO_SIDED * sd
    return Estimate(value=value, sd=sd, interval=(value - half, value + half), level=0.95, unit=unit)


def _quadratic(gradient: Array, covariance: Array) -> float:
    """The variance that a covariance gives to a combination; infinite where the covariance doesn't resolve it."""
    at = np.flatnonzero(gradient)
    part = covariance[np.ix_(at, at)]
    if not np.isfinite(part).all():
        return np.inf
    terms = gradient[at][:, None] * part * gradient[at]
    # Two parameters that run to infinity together leave a difference of huge terms, of which rounding may be all that is left.
    rounding = np.abs(terms - terms.T).sum() + terms.size * np.finfo(float).eps * np.abs(terms).sum()
    return float(terms.sum()) if terms.sum() > rounding else np.inf

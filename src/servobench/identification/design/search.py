"""The verb design: the most informative experiment under limits, and the intervals to expect from it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import TypeAdapter

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import TWO_SIDED
from servobench.identification.design.assumed_motor import AssumedMotor
from servobench.identification.design.candidates import Candidate, Shape, candidates
from servobench.identification.design.foresight import Foresight, count_position, draw_motors, foresee
from servobench.identification.design.limits import DesignLimits, limit_use
from servobench.identification.identify import identify
from servobench.rig.experiment import PAPER, Experiment, Limits
from servobench.systems.signals.base import AnySignal, Signal

SCHEMA = "servobench.design/1"
Wish: TypeAlias = Literal["time_constant", "gain", "both"]

_FULL = 0.98  # of each limit: what is exactly at a limit may be taken for clipped
_HALVINGS = 12
_QUICK, _THOROUGH = 4, 60  # motors drawn for the first look, and for those that come near
_NEAR = 8
_REHEARSALS = 6
_FAR = 5.0  # predicted standard deviations; an error beyond that isn't chance
_ROUNDS = 1.25  # times: rounding that scatters the estimates by more than white noise would depends on luck
_MOST_SAMPLES = 100_000  # some two minutes and 1 GB
_LEAST = 0.05  # of the voltage: a signal that has to be smaller is none


@dataclass(frozen=True, kw_only=True)
class RatedSignal:
    """A signal of a `family`, and what it will tell: `sd` in SI units, `relative` to gain and time constant.

    `structure` is the model that the parameters belong to, `rounding` as in `Foresight`; `used` is how much of each limit it
    takes.
    """

    family: str
    signal: Signal
    structure: str
    sd: Mapping[str, float]
    relative: Mapping[str, float]
    rounding: float
    used: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, repr=False)
class Design:
    """The experiment for a `wish`, as `chosen`, the best of the `others`, one of each family, and the paper's square wave.

    `active` names the limits that keep it from telling more; `assumptions` are sentences.
    """

    experiment: Experiment
    wish: Wish
    chosen: RatedSignal
    others: tuple[RatedSignal, ...]
    paper: RatedSignal
    active: tuple[str, ...]
    assumptions: tuple[str, ...]

    def __str__(self) -> str:
        """The experiment's file, what it will tell of gain and time constant, and what limits it."""
        tells = ", ".join(
            f"{parameter_in_words(name)} to {100 * TWO_SIDED * sd:.2g} %"
            for name, sd in self.chosen.relative.items()
        )
        return f"{self.chosen.family}: {tells}; limited by {' and '.join(self.active)}\n\n{self.experiment.to_toml()}"

    __repr__ = __str__

    def to_dict(self) -> dict[str, Any]:
        """Return the design as plain data of the schema `servobench.design/1`."""
        return {
            "schema": SCHEMA,
            "for": self.wish,
            "experiment": self.experiment.to_toml(),
            "chosen": _plain(self.chosen),
            "others": [_plain(other) for other in self.others],
            "paper": _plain(self.paper),
            "active": list(self.active),
            "assumptions": list(self.assumptions),
        }


def best_design(
    motor: AssumedMotor,
    limits: DesignLimits,
    duration: float = 10.0,
    sample_time: float = 0.002,
    wish: Wish = "both",
) -> Design:
    """Return the experiment with the smallest predicted interval that keeps every motor within the tolerance inside the limits.

    `duration` and `sample_time` in seconds. `wish` is what the interval is to be small of; for "both" it is the product of the
    relative intervals of gain and time constant. An experiment is only chosen if the encoder's rounding averages out in it, and
    if its rehearsals, simulated and identified, come out within 5 predicted standard deviations.
    Raises `UsageError` for a duration that is no experiment or too long to compare any, `MissingInformation` for a limit that
    nothing is known for, `NotIdentifiable` where no experiment keeps the limits.
    """
    limits.check(motor)
    if not (math.isfinite(duration) and duration >= 10 * sample_time > 0):
        raise UsageError(
            f"a duration of {duration:g} s at a sample time of {sample_time:g} s is too short an experiment; "
            "expected at least ten samples"
        )
    if duration > _MOST_SAMPLES * sample_time:
        raise UsageError(
            f"a duration of {duration:g} s at a sample time of {sample_time:g} s is {duration / sample_time:.4g} "
            f"samples, too many to compare experiments; expected at most {_MOST_SAMPLES}: a duration of "
            f"{_MOST_SAMPLES * sample_time:g} s, or a longer sample time"
        )
    t = np.arange(round(duration / sample_time), dtype=np.float64) * sample_time
    signals = [
        signal
        for candidate in candidates(motor, duration, sample_time)
        if (signal := _rate_candidate(motor, limits, t, candidate)) is not None
    ]
    if not signals and _FULL * limits.voltage <= 1.5 * motor.coulomb_voltage:
        raise NotIdentifiable(
            f"{limits.voltage:g} V hardly moves the motor, as friction takes {motor.coulomb_voltage:.2g} V: allow at "
            f"least {1.6 * motor.coulomb_voltage:.2g} V"
        )
    if not signals:
        raise NotIdentifiable(
            f"no experiment of {duration:g} s moves the motor within the limits: allow more travel, speed or "
            "current, or a shorter sample time"
        )
    ranked = _rank(motor, t, sorted(signals, key=lambda each: cost(each, wish)), wish)
    chosen = _reliable(motor, t, ranked)
    others = _best_of_each_family([each for each in ranked if each is not chosen], chosen.family)
    paper = _rate(motor, limits, t, "the paper's square wave", PAPER.signal, _THOROUGH)
    active = [name for name, part in chosen.used.items() if part > 0.95 * _FULL]
    return Design(
        experiment=_experiment(motor, limits, chosen, duration, sample_time),
        wish=wish,
        chosen=chosen,
        others=others,
        paper=paper,
        active=(*active, "time"),
        assumptions=motor.assumptions,
    )


def cost(each: RatedSignal, wish: Wish) -> float:
    """Return what is to be small: a relative standard deviation, or the geometric mean of both."""
    if wish == "both":
        return math.sqrt(each.relative["gain"] * each.relative["time_constant"])
    return each.relative[wish]


def _rate_candidate(
    motor: AssumedMotor, limits: DesignLimits, t: Array, candidate: Candidate
) -> RatedSignal | None:
    """A candidate as large as the limits allow; None where it would have to be too small to move the motor."""
    top = _largest(motor, limits, t, candidate.shape)
    if top is None:
        return None
    return _rate(motor, limits, t, candidate.family, candidate.shape(top), _QUICK)


def _largest(motor: AssumedMotor, limits: DesignLimits, t: Array, shape: Shape) -> float | None:
    """The largest voltage [V] of a shape within the limits, to three digits."""
    low, high = 0.0, _FULL * limits.voltage
    if not _keeps(motor, limits, t, shape(high)):
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if _keeps(motor, limits, t, shape(middle)) else (low, middle)
        high = low
    least = max(_LEAST * limits.voltage, 1.5 * motor.coulomb_voltage)
    digits = 10.0 ** (math.floor(math.log10(high)) - 2) if high > 0 else 1.0
    top = math.floor(high / digits + 1e-9) * digits
    return round(top, 12) if top > least else None


def _keeps(motor: AssumedMotor, limits: DesignLimits, t: Array, signal: Signal) -> bool:
    return all(part <= _FULL * (1 + 1e-9) for part in limit_use(motor, limits, t, signal(t)).values())


def _rate(
    motor: AssumedMotor, limits: DesignLimits, t: Array, family: str, signal: Signal, draws: int
) -> RatedSignal:
    u = signal(t)
    ahead: Foresight = foresee(motor, t, u, draws)
    return RatedSignal(
        family=family,
        signal=signal,
        structure=ahead.structure,
        sd=ahead.sd,
        relative={
            "gain": ahead.sd["gain"] / abs(motor.gain),
            "time_constant": ahead.sd["time_constant"] / motor.time_constant,
        },
        rounding=ahead.rounding,
        used=limit_use(motor, limits, t, u),
    )


def _rank(motor: AssumedMotor, t: Array, signals: Sequence[RatedSignal], wish: Wish) -> list[RatedSignal]:
    """The nearest to the best, and the best of each family, looked at thoroughly and put in order."""
    near = list(signals[:_NEAR])
    near += [each for each in _best_of_each_family(signals, "") if each not in near]
    thorough = []
    for each in near:
        ahead = foresee(motor, t, each.signal(t), _THOROUGH)
        scale = {"gain": abs(motor.gain), "time_constant": motor.time_constant}
        relative = {name: ahead.sd[name] / value for name, value in scale.items()}
        thorough.append(replace(each, sd=ahead.sd, relative=relative, rounding=ahead.rounding))
    return sorted(thorough, key=lambda each: cost(each, wish))


def _best_of_each_family(signals: Sequence[RatedSignal], without: str) -> tuple[RatedSignal, ...]:
    best: dict[str, RatedSignal] = {}
    for each in signals:
        best.setdefault(each.family, each)
    return tuple(each for each in best.values() if each.family != without)


def _reliable(motor: AssumedMotor, t: Array, ranked: Sequence[RatedSignal]) -> RatedSignal:
    """The first experiment of which rounding averages out and whose rehearsals come out as foretold."""
    steady = [each for each in ranked if each.rounding <= _ROUNDS]
    for each in steady:
        if _rehearse(motor, t, each):
            return each
    raise NotIdentifiable(
        f"none of the {len(ranked)} best experiments came out as predicted when simulated and identified: allow more "
        "voltage, travel or time"
    )


def _rehearse(motor: AssumedMotor, t: Array, each: RatedSignal) -> bool:
    """Whether motors drawn within the tolerance are identified as foretold."""
    u = each.signal(t)
    for real, random in draw_motors(motor, _REHEARSALS):
        position, _ = real.motion(t, u)
        data = real.dataset(t, u, count_position(real, position, random))
        fit = identify(data).fit
        if fit is None:
            return False
        for name, truth in (("gain", real.gain), ("time_constant", real.time_constant)):
            # What a parameter is foretold to scatter by grows with the parameter, by the tolerance at the most.
            if abs(fit[name].value - truth) > _FAR * (1 + motor.tolerance) * each.sd[name]:
                return False
    return True


def _experiment(
    motor: AssumedMotor, limits: DesignLimits, chosen: RatedSignal, duration: float, sample_time: float
) -> Experiment:
    notes = (
        f"Designed for {motor.name}: predicted standard deviations {100 * chosen.relative['gain']:.2g} % of the gain and "
        f"{100 * chosen.relative['time_constant']:.2g} % of the time constant."
    )
    return Experiment(
        name="designed",
        notes=notes,
        signal=chosen.signal,
        duration=duration,
        sample_time=sample_time,
        limits=Limits(voltage=limits.voltage),
    )


def _plain(each: RatedSignal) -> dict[str, Any]:
    return {
        "family": each.family,
        "signal": TypeAdapter(AnySignal).dump_python(each.signal, mode="json"),
        "structure": each.structure,
        "sd": dict(each.sd),
        "relative": dict(each.relative),
        "rounding": each.rounding,
        "used": dict(each.used),
    }

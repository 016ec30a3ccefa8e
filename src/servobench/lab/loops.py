"""What the studies of loops share: the motor that theory is computed with, and what is read off a step response."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from servobench.channels import Array
from servobench.control.base import Controller
from servobench.control.lead import Lead
from servobench.control.pid import Pid
from servobench.control.state_feedback import StateFeedback
from servobench.errors import UsageError
from servobench.experiment import Experiment
from servobench.lab.expression import Expression
from servobench.lab.studies.base import Stand, StudySettings
from servobench.models.base import Output
from servobench.recording.recording import Recording
from servobench.signals.step import Step
from servobench.transfer_function import TransferFunction
from servobench.tuning.base import Tunable

_STUCK = 0.1  # of the time to the peak; a second-order loop is within a count of it for less


class OfAMotor(StudySettings):
    """What the settings of studies have that compute with K/(τs + 1): where its two numbers come from."""

    gain: str = "sheet_gain"
    """The motor's gain K, an expression over facts [rad/(s·V)]."""
    time_constant: str = "sheet_time_constant"
    """Its time constant τ, an expression over facts [s]."""

    @model_validator(mode="after")
    def _can_be_computed(self) -> Self:
        Expression(self.gain)
        Expression(self.time_constant)
        return self

    def motor(self, stand: Stand) -> tuple[float, float]:
        """Return K and τ; raises `UnknownName` for a fact that isn't there."""
        gain, tau = (Expression(text).evaluate(stand.facts).value for text in (self.gain, self.time_constant))
        if not tau > 0:
            raise UsageError(f"the time constant `{self.time_constant}` is {tau:g} s; expected more than 0")
        return gain, tau


def motor_system(gain: float, tau: float, output: Output) -> TransferFunction:
    """Return K/(τs + 1) to the speed, K/(s (τs + 1)) to the position."""
    if output == "speed":
        return TransferFunction(numerator=(gain,), denominator=(tau, 1.0), output="speed", unit="rad/(s·V)")
    return TransferFunction(numerator=(gain,), denominator=(tau, 1.0, 0.0), output="position", unit="rad/V")


def on_paper(law: Tunable, gain: float, tau: float) -> TransferFunction:
    """Return the open loop of a law as it is written: continuous, with a derivative without filter, without hold and delay."""
    below: tuple[float, ...] = (tau, 1.0) if law.output == "speed" else (tau, 1.0, 0.0)
    if isinstance(law, Lead):
        above: tuple[float, ...] = (law.gain / law.zero, law.gain)
        below = tuple(map(float, np.convolve(below, (1 / law.pole, 1.0))))
    else:
        if isinstance(law, Pid):
            powers = (law.kd, law.kp, law.ki)
        elif law.output == "position":
            powers = (law.speed_gain, law.position_gain, law.integral_gain)
        else:
            powers = (0.0, law.speed_gain, law.integral_gain)
        above = powers if powers[2] else powers[:2]
        below = (*below, 0.0) if len(above) == 3 else below
    return TransferFunction(
        numerator=tuple(gain * c for c in above), denominator=below, output=law.output, unit="1"
    )


def tunable(controller: Controller) -> Tunable:
    """Return a controller that a loop can be computed of; raises `UsageError` for another."""
    if isinstance(controller, Pid | Lead | StateFeedback):
        return controller
    raise UsageError(
        f"{type(controller).__name__} is no feedback law that a loop is computed of; expected pid, lead or state_feedback"
    )


def step_of(experiment: Experiment) -> Step:
    """Return the step that an exercise's experiment makes; raises `UsageError` for another signal."""
    if isinstance(experiment.signal, Step) and experiment.signal.final != experiment.signal.initial:
        return experiment.signal
    raise UsageError(
        "the study reads a step response, and the experiment's signal is no step; give [signal] the type step"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """What followed a step: times (N,) [s] from the step on, and output and voltage (N,) at them."""

    t: Array
    output: Array
    voltage: Array


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """Figures of a step response.

    `overshoot` [1] is how far it goes beyond the step, as a part of it; `peak_time` [s] when it is farthest, NaN where it doesn't
    go beyond; `error` what is missing at the end, in the output's unit; `voltage` [V] the largest voltage, either way.
    """

    peak_time: float
    overshoot: float
    error: float
    voltage: float


def course_after(recording: Recording, step: Step, output: Output, chain: str) -> Course:
    """Return what happened from a step on, the speed through a chain."""
    from servobench.measurement.measure import measure

    data = measure(recording, chain if output == "speed" else None)
    commanded = recording["commanded"]
    after = data.t_output >= step.start - 1e-9
    t = data.t_output[after]
    at = np.clip(np.searchsorted(data.t_input, t + 1e-9) - 1, 0, len(data.t_input) - 1)
    return Course(t=t - step.start, output=data.y[after], voltage=commanded.values[at])


def figures_of(course: Course, initial: float, final: float) -> StepFigures:
    """Return the figures of a step response from `initial` to `final`, of which the last tenth is taken as its end."""
    rise = (course.output - initial) / (final - initial)
    most = float(rise.max())
    peak = _peak_time(course.t, rise >= most - 1e-9) if most > 1 else math.nan
    last = max(len(rise) // 10, 1)
    return StepFigures(
        peak_time=peak,
        overshoot=max(most - 1.0, 0.0),
        error=float(final - course.output[-last:].mean()),
        voltage=float(np.abs(course.voltage).max()),
    )


def _peak_time(t: Array, at_most: NDArray[np.bool_]) -> float:
    """When a course is at its largest value: an encoder shows it for several samples, of which the middle is nearest to the peak.

    A shaft that sticks there shows it for longer; then it is when it got there.
    """
    first = int(np.argmax(at_most))
    length = int(np.argmin(np.append(at_most[first:], False)))
    last = first + length - 1
    return float(t[first] if t[last] - t[first] > _STUCK * t[first] else 0.5 * (t[first] + t[last]))


def without_friction(controller: Tunable, gain: float, tau: float, experiment: Experiment) -> Course:
    """Return the response to a unit step of the loop as it runs, tick by tick, around a motor without friction and limits."""
    from servobench.tuning.response import unit_step

    step = step_of(experiment)
    length = (experiment.duration or 0.0) - step.start
    ticks = max(math.ceil(length / experiment.sample_time), 2)
    found = unit_step(controller, gain, tau, 0.0, experiment.sample_time, ticks)
    return Course(t=found.t, output=found.output, voltage=found.voltage)

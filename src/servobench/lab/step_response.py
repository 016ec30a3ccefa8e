"""The response of a loop to a step of its reference: what the reference does, what follows, and what is read off it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.identification.models.base import Output
from servobench.recordings.measurement.base import Chain
from servobench.recordings.recording import Recording
from servobench.rig.experiment import Experiment
from servobench.systems.signals.ramp import Ramp
from servobench.systems.signals.step import Step
from servobench.systems.tuning.base import Tunable

_STUCK = 0.1  # of the time to the peak; a second-order loop is within a count of it for less
_NO_PEAK = 1e-4  # of a step; an encoder shows a twentieth of a count of a step of 1 rad


@dataclass(frozen=True, kw_only=True)
class Change:
    """A step of a reference at `start` [s]: of the position or the speed, from `initial` to `final`, in `unit`.

    A ramp of the position is a step of the speed, and a loop around the position answers it with the same transfer function.
    """

    of: Output
    start: float
    initial: float
    final: float
    unit: str

    @property
    def size(self) -> float:
        """The height of the step."""
        return self.final - self.initial

    def __str__(self) -> str:
        return f"a step of the {self.of} of {plain(self.size)} {self.unit}"


def change_of(experiment: Experiment) -> Change:
    """Return the step that an experiment's reference makes; raises `UsageError` for a signal that makes none."""
    signal, unit = experiment.signal, experiment.controller.reference_unit
    if isinstance(signal, Step) and signal.final != signal.initial and unit != "V":
        of: Output = "position" if unit == "rad" else "speed"
        return Change(of=of, start=signal.start, initial=signal.initial, final=signal.final, unit=unit)
    if isinstance(signal, Ramp) and signal.final != signal.initial and unit == "rad":
        slope = (signal.final - signal.initial) / signal.duration
        return Change(of="speed", start=signal.start, initial=0.0, final=slope, unit="rad/s")
    raise UsageError(
        "the study reads a step response of a closed loop; give [signal] the type step, or ramp for a step of the speed of a "
        "position loop, and [controller] a feedback law"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """The response to a step: times (N,) [s] from the step on, and output and voltage (N,) at them."""

    t: Array
    output: Array
    voltage: Array


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """Figures of a step response.

    `overshoot` [1] is how far it goes beyond the step, as a part of it; `peak_time` [s] when it is farthest, NaN where it doesn't
    go beyond; `rise_time` [s] how long it takes from 10 to 90 % of the step, NaN where it doesn't get
    there; `error` what is missing at the end, in the output's unit; `voltage` [V] the largest voltage, either way.
    """

    peak_time: float
    overshoot: float
    rise_time: float
    error: float
    voltage: float


def response_after(recording: Recording, start: float, of: Output, chain: str) -> Response:
    """Return what happened from a time [s] on, the speed through a chain."""
    from servobench.recordings.measurement.measure import measure

    data = measure(recording, chain if of == "speed" else None)
    after = data.t_output >= start - 1e-9
    t = data.t_output[after]
    commanded = np.interp(t, np.asarray(recording["commanded"].t), recording["commanded"].values)
    return Response(t=t - start, output=data.y[after], voltage=commanded)


def figures_of(response: Response, initial: float, final: float) -> StepFigures:
    """Return the figures of a step response from `initial` to `final`; its last tenth counts as its end."""
    rise = (response.output - initial) / (final - initial)
    most = float(rise.max())
    goes_beyond = most - 1 > _NO_PEAK
    peak = _peak_time(response.t, rise >= most - 1e-9) if goes_beyond else math.nan
    last = max(len(rise) // 10, 1)
    return StepFigures(
        peak_time=peak,
        overshoot=most - 1.0 if goes_beyond else 0.0,
        rise_time=_reaches(response.t, rise, 0.9) - _reaches(response.t, rise, 0.1),
        error=float(final - response.output[-last:].mean()),
        voltage=float(np.abs(response.voltage).max()),
    )


def _reaches(t: Array, rise: Array, part: float) -> float:
    """The time at which a course first reaches a part of the step, on a line between two samples; NaN where it doesn't."""
    at = int(np.argmax(rise >= part))
    if rise[at] < part or at == 0:
        return math.nan
    return float(np.interp(part, rise[at - 1 : at + 1], t[at - 1 : at + 1]))


def _peak_time(t: Array, at_most: NDArray[np.bool_]) -> float:
    """The time of a course's largest value: the middle of the samples for which an encoder shows it.

    A shaft that sticks there shows it for longer; then it is when it got there.
    """
    first = int(np.argmax(at_most))
    length = int(np.argmin(np.append(at_most[first:], False)))
    last = first + length - 1
    return float(t[first] if t[last] - t[first] > _STUCK * t[first] else 0.5 * (t[first] + t[last]))


def without_friction(
    controller: Tunable, gain: float, tau: float, experiment: Experiment, chain: str
) -> Response:
    """Return the answer of the loop as it runs, tick by tick, to the experiment's reference, without friction and limits.

    The motor has the gain K [rad/(s·V)] and the time constant τ [s].
    A speed is examined through the same chain as that of the run.
    """
    from servobench.systems.tuning.response import unit_step

    change, h = change_of(experiment), experiment.sample_time
    ticks = max(math.ceil(((experiment.duration or 0.0) - change.start) / h), 2)
    response = unit_step(controller, gain, tau, 0.0, h, ticks)
    output = change.size * response.output
    if change.of == "speed":
        # At the ticks a ramp is the sum of steps, each a tick later than the one before and the first a tick after its start.
        travelled = np.concatenate([[0.0], np.cumsum(h * output[:-1])])
        output = Chain.parse(chain)(travelled, response.t)
    return Response(t=response.t, output=change.initial + output, voltage=change.size * response.voltage)

"""PI control as a small board computes it, and for a device that does so by itself."""

from __future__ import annotations

import math
from typing import NamedTuple

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.settings import Settings
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.control.running import UNITS, Integral, Output, Proportional, Shaft, shaft_of

SPEED_WINDOW = 0.008  # s; the speed is the motion in it
FADE_TIME = 0.5  # s


class PiState(NamedTuple):
    """The law's constants of the run, and its memory."""

    sample_time: float
    """Time between two samples [s]."""
    shaft: Shaft
    """The device's properties that it needs."""
    integral: float
    """ki times the errors so far [V]."""
    bias: float
    """The remainder of another law's voltage [V]."""
    travel: int
    """Unwrapped counts of the last sample."""
    before: tuple[int, ...]
    """The same of the samples in the window of the speed; none before the first."""


@CONTROLLERS.member("pi")
class Pi(Settings):
    """u = kp e + Σ ki T e, e = r - y at each sample, T apart; y is the position θ or the speed, the motion in the last 8 ms.

    At the limit of the voltage the sum stands still, unless the error takes it back (conditional integration; Åström and
    Hägglund, Advanced PID Control, 2006, section 3.5). A device that computes this law by itself, such as the rig, is given it:
    then no delay of the computer is in the loop. For any other device, or where the rig can't, the computer computes the same.
    """

    output: Output = "position"
    """The controlled output: position or speed."""
    kp: Proportional = 1.0
    """Proportional gain, in V/rad for a position, V·s/rad for a speed."""
    ki: Integral = 0.0
    """Integral gain, in V/(rad·s) for a position, V/rad for a speed."""

    @property
    def reference_unit(self) -> str:
        """The unit of what is followed, rad or rad/s."""
        return UNITS[self.output]

    @property
    def symbol(self) -> tuple[str, ...]:
        """The law from the error to the voltage, for a diagram."""
        terms = ((self.kp, ""), (self.ki, "/s"))
        return (" + ".join(f"{gain:g}{power}" for gain, power in terms if gain) or "0",)

    def start(self, sample_time: float, info: DeviceInfo) -> PiState:
        """Return the state at rest; raises `UsageError` for a device that doesn't tell the shaft's angle."""
        return PiState(sample_time, shaft_of(info, "pi"), 0.0, 0.0, 0, ())

    def step(self, state: PiState, reference: float, sample: Sample) -> tuple[PiState, float]:
        """Return the voltage [V] for a reference [rad or rad/s]."""
        sample_time, shaft = state.sample_time, state.shaft
        travel = _travel_to(state, sample.counts)
        before = state.before or (travel,) * max(1, round(SPEED_WINDOW / sample_time))
        measured = travel * shaft.scale
        if self.output == "speed":
            measured = (travel - before[0]) * shaft.scale / (len(before) * sample_time)
        error = reference - measured
        integral = _within(state.integral + self.ki * sample_time * error, shaft)
        voltage = self.kp * error + integral + state.bias
        limited = _within(voltage, shaft)
        if voltage != limited and (voltage > limited) == (error > 0):
            integral = state.integral
        bias = state.bias * math.exp(-sample_time / FADE_TIME)
        return PiState(sample_time, shaft, integral, bias, travel, (*before[1:], travel)), voltage

    def take_over(
        self, sample_time: float, info: DeviceInfo, reference: float, sample: Sample, voltage: float
    ) -> PiState:
        """Return the state from which the voltage goes on; what the law doesn't give by itself fades within some 0.5 s."""
        state = self.start(sample_time, info)._replace(travel=sample.counts)
        _, alone = self.step(state, reference, sample)
        return state._replace(bias=voltage - alone)


def _travel_to(state: PiState, counts: int) -> int:
    """The counts without the counter's wraps: the shortest way from the sample before."""
    if not state.shaft.modulus:
        return counts
    modulus = int(state.shaft.modulus)
    return state.travel + (counts - state.travel + modulus // 2) % modulus - modulus // 2


def _within(voltage: float, shaft: Shaft) -> float:
    return min(max(voltage, shaft.lowest), shaft.highest)

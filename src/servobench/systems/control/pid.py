"""PID control of the position or the speed, with anti-windup and a filtered derivative."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.settings import PositiveTime, Settings
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.control.running import (
    UNITS,
    Cutoff,
    Derivative,
    FadeTime,
    Finite,
    Integral,
    Output,
    Proportional,
    Running,
    advance,
    begin_law,
    shaft_of,
    take_over,
)


@CONTROLLERS.member("pid")
class Pid(Settings):
    """u = kp (b r - y) + ∫ ki (r - y) dt + kd d/dt (c r - y), y the position θ or the filtered speed ω.

    The derivative goes through ω_c/(s + ω_c), computed as the measurement chain `derivative | lowpass ω_c` is; so does the speed
    that is followed. Where the voltage would be beyond what the device can put out, the integral follows what is left of it:
    dI/dt = ki e + (limited - u)/T_t (back-calculation; Åström and Hägglund, Advanced PID Control, 2006, section 3.5).
    """

    output: Output = "position"
    """The controlled output: position or speed."""
    kp: Proportional = 1.0
    """Proportional gain, in V/rad for a position, V·s/rad for a speed."""
    ki: Integral = 0.0
    """Integral gain, in V/(rad·s) for a position, V/rad for a speed."""
    kd: Derivative = 0.0
    """Derivative gain, in V·s/rad for a position, V·s²/rad for a speed."""
    b: Finite = 1.0
    """Weight of the reference in the proportional part; less than 1 lessens the overshoot."""
    c: Finite = 0.0
    """Weight of the reference in the derivative part; at 0 a step of the reference makes no spike of the voltage."""
    cutoff: Cutoff = 100.0
    """Cut-off of the low-pass filter of speed and derivative [rad/s]."""
    tracking_time: PositiveTime | None = None
    """T_t of the anti-windup; without it kp/ki [s]."""
    fade_time: FadeTime = 0.5
    """Without an integral part: time constant with which a switch from another law fades; at 0 the voltage jumps [s]."""

    @property
    def reference_unit(self) -> str:
        """The unit of what is followed, rad or rad/s."""
        return UNITS[self.output]

    @property
    def symbol(self) -> tuple[str, ...]:
        """The law from the error to the voltage, without the filter of the derivative, for a diagram."""
        terms = ((self.kp, ""), (self.ki, "/s"), (self.kd, "·s"))
        return (" + ".join(f"{gain:g}{power}" for gain, power in terms if gain) or "0",)

    def start(self, sample_time: float, info: DeviceInfo) -> Running:
        """Return the state at rest; raises `UsageError` for a device that doesn't tell the shaft's angle."""
        from servobench.systems.control import kernels

        shaft = shaft_of(info, "pid")
        own = (self.output == "speed", self.ki, self._tracking_time(sample_time), self.fade_time)
        gains = (self.kp, self.kd, self.b, self.c)
        p = np.array([sample_time, *shaft, self.cutoff, *own, *gains], dtype=np.float64)
        return begin_law(kernels.pid, p, np.zeros(kernels.OWN + 5))

    def step(self, state: Running, reference: float, sample: Sample) -> tuple[Running, float]:
        """Return the voltage [V] for a reference [rad or rad/s]."""
        return advance(state, reference, sample)

    def take_over(
        self, sample_time: float, info: DeviceInfo, reference: float, sample: Sample, voltage: float
    ) -> Running:
        """Return the state from which the voltage goes on; the integral makes up the difference, or a bias that fades."""
        return take_over(
            self.start(sample_time, info),
            reference,
            sample,
            voltage,
            integral=self.ki != 0,
            fade_time=self.fade_time,
        )

    def _tracking_time(self, sample_time: float) -> float:
        """T_t [s]; an integral alone is taken back within a sample time."""
        if self.tracking_time is not None:
            return self.tracking_time
        if self.ki == 0 or self.kp == 0:
            return sample_time
        return abs(self.kp / self.ki)

"""State feedback of position and speed, with an optional integral part."""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.settings import In, PositiveTime, Settings
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.control.running import (
    UNITS,
    Cutoff,
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


@CONTROLLERS.member("state_feedback")
class StateFeedback(Settings):
    """u = k_r r - k_θ θ - k_ω ω + ∫ k_i (r - y) dt, θ the position, ω the filtered speed, y the one that is followed.

    The integral of the error is one more state (Åström and Murray 2008, chapter 6); its anti-windup is that of `pid`.
    """

    output: Output = "position"
    """The controlled output: position or speed."""
    position_gain: Annotated[Finite, In("V/rad")] = 1.0
    """k_θ; has to be 0 where a speed is followed, as the position has no place to go to then [V/rad]."""
    speed_gain: Annotated[Finite, In("V·s/rad")] = 0.0
    """k_ω [V·s/rad]."""
    integral_gain: Integral = 0.0
    """k_i, in V/(rad·s) for a position, V/rad for a speed."""
    reference_gain: Proportional | None = None
    """k_r; without it the gain of what is followed, in V/rad for a position, V·s/rad for a speed."""
    cutoff: Cutoff = 100.0
    """Cut-off of the low-pass filter of the speed [rad/s]."""
    tracking_time: PositiveTime | None = None
    """T_t of the anti-windup; without it the gain of what is followed over k_i [s]."""
    fade_time: FadeTime = 0.5
    """Without an integral part: time constant with which a switch from another law fades; at 0 the voltage jumps [s]."""

    @model_validator(mode="after")
    def _follows_one(self) -> Self:
        if self.output == "speed" and self.position_gain != 0:
            raise ValueError(
                f"position_gain = {self.position_gain:g} V/rad would hold the shaft, although the speed is "
                "controlled; set position_gain = 0"
            )
        return self

    @property
    def reference_unit(self) -> str:
        """The unit of what is followed, rad or rad/s."""
        return UNITS[self.output]

    @property
    def symbol(self) -> tuple[str, ...]:
        """The law, for a diagram."""
        followed = self.speed_gain if self.output == "speed" else self.position_gain
        forward = followed if self.reference_gain is None else self.reference_gain
        terms = (
            (forward, "r"),
            (-self.position_gain, "θ"),
            (-self.speed_gain, "ω"),
            (self.integral_gain, "∫e"),
        )
        text = " + ".join(f"{gain:g} {of}" for gain, of in terms if gain)
        return (text.replace("+ -", "− ").replace("-", "−") or "0",)

    def start(self, sample_time: float, info: DeviceInfo) -> Running:
        """Return the state at rest; raises `UsageError` for a device that doesn't tell the shaft's angle."""
        from servobench.systems.control import kernels

        followed = self.speed_gain if self.output == "speed" else self.position_gain
        tracking = self.tracking_time or (abs(followed / self.integral_gain) if self.integral_gain else 0.0)
        forward = followed if self.reference_gain is None else self.reference_gain
        own = (self.output == "speed", self.integral_gain, tracking or sample_time, self.fade_time)
        gains = (self.position_gain, self.speed_gain, forward)
        shaft = shaft_of(info, "state_feedback")
        p = np.array([sample_time, *shaft, self.cutoff, *own, *gains], dtype=np.float64)
        return begin_law(kernels.state_feedback, p, np.zeros(kernels.OWN))

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
            integral=self.integral_gain != 0,
            fade_time=self.fade_time,
        )

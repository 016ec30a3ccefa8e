"""Lead compensation of the position or the speed."""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import model_validator

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.settings import Settings
from servobench.systems.control.base import CONTROLLERS
from servobench.systems.control.running import (
    UNITS,
    Cutoff,
    FadeTime,
    Output,
    Proportional,
    Running,
    advance,
    begin_law,
    shaft_of,
    take_over,
)


@CONTROLLERS.member("lead")
class Lead(Settings):
    """u = gain (1 + s/zero)/(1 + s/pole) (r - y), y the position θ or the filtered speed ω, by the trapezoid rule.

    The phase rises by arcsin((pole - zero)/(pole + zero)) at √(zero pole) (Franklin, Powell and
    Emami-Naeini 2015, chapter 6). Without an integral part, friction and load leave an error.
    """

    output: Output = "position"
    """The controlled output: position or speed."""
    gain: Proportional = 1.0
    """Gain at rest, in V/rad for a position, V·s/rad for a speed."""
    zero: Cutoff = 10.0
    """The frequency at which the gain begins to rise [rad/s]."""
    pole: Cutoff = 100.0
    """The frequency at which the gain stops rising; above the zero [rad/s]."""
    cutoff: Cutoff = 100.0
    """Cut-off of the low-pass filter of the speed, where that is followed [rad/s]."""
    fade_time: FadeTime = 0.5
    """Time constant with which a switch from another law fades; at 0 the voltage jumps [s]."""

    @model_validator(mode="after")
    def _leads(self) -> Self:
        if self.pole <= self.zero:
            raise ValueError(
                f"pole = {self.pole:g} rad/s is not above zero = {self.zero:g} rad/s, so it lags; exchange them"
            )
        return self

    @property
    def reference_unit(self) -> str:
        """The unit of what is followed, rad or rad/s."""
        return UNITS[self.output]

    @property
    def symbol(self) -> tuple[str, ...]:
        """Numerator and denominator from the error to the voltage, for a diagram."""
        return f"{self.gain:g} (1 + s/{self.zero:g})", f"1 + s/{self.pole:g}"

    def start(self, sample_time: float, info: DeviceInfo) -> Running:
        """Return the state at rest; raises `UsageError` for a device that doesn't tell the shaft's angle."""
        from servobench.systems.control import kernels

        own = (self.output == "speed", 0.0, sample_time, self.fade_time, self.gain, self.zero, self.pole)
        p = np.array([sample_time, *shaft_of(info, "lead"), self.cutoff, *own], dtype=np.float64)
        return begin_law(kernels.lead, p, np.zeros(kernels.OWN + 2))

    def step(self, state: Running, reference: float, sample: Sample) -> tuple[Running, float]:
        """Return the voltage [V] for a reference [rad or rad/s]."""
        return advance(state, reference, sample)

    def take_over(
        self, sample_time: float, info: DeviceInfo, reference: float, sample: Sample, voltage: float
    ) -> Running:
        """Return the state from which the voltage goes on; the compensator is settled, and a bias fades."""
        return take_over(
            self.start(sample_time, info),
            reference,
            sample,
            voltage,
            integral=False,
            fade_time=self.fade_time,
        )

"""No control: the reference is the voltage."""

from __future__ import annotations

import math
from typing import TypeAlias

from servobench.channels import DeviceInfo, Sample
from servobench.control.base import CONTROLLERS
from servobench.control.running import FadeTime, faded
from servobench.settings import Settings

Bias: TypeAlias = tuple[float, float] | None
"""What is added to the reference [V], and when that was [s]; None where nothing is."""


@CONTROLLERS.member("open_loop")
class OpenLoop(Settings):
    """u[k] = r[k]: the reference [V] goes to the motor as it is.

    After a switch from another law the voltage goes over to the reference gradually: u = r + u_b e^(-t/fade_time)
    (docs/decisions/0019-control.md).
    """

    fade_time: FadeTime = 0.5
    """Time constant with which a switch from another law fades; at 0 the voltage jumps [s]."""

    @property
    def reference_unit(self) -> str:
        """Volts."""
        return "V"

    @property
    def symbol(self) -> tuple[str, ...]:
        """What the reference is multiplied by, for a diagram."""
        return ("1",)

    def start(self, sample_time: float, info: DeviceInfo) -> Bias:
        """Return the state: nothing is added."""
        return None

    def step(self, state: Bias, reference: float, sample: Sample) -> tuple[Bias, float]:
        """Return the reference as the voltage [V], and what is left of the bias with it."""
        if state is None:
            return None, reference
        bias, before = state
        left = faded(bias, sample.time - before, self.fade_time)
        return (left, sample.time) if left else None, reference + left

    def take_over(
        self, sample_time: float, info: DeviceInfo, reference: float, sample: Sample, voltage: float
    ) -> Bias:
        """Return the state from which the voltage goes on, and fades to the reference."""
        bias = voltage - reference
        return (bias, sample.time) if self.fade_time and math.isfinite(bias) and bias else None

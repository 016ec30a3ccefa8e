"""A ramp from one value to another."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.settings import PositiveTime, Settings, Time
from servobench.systems.signals.base import SIGNALS, Level


@SIGNALS.member("ramp")
class Ramp(Settings):
    """A straight line from `initial` at `start` to `final` at start + duration; constant before and after."""

    initial: Level = 0.0
    """Value before the ramp [V]."""
    final: Level = 3.0
    """Value after the ramp [V]."""
    start: Time = 0.0
    """Time at which the ramp begins [s]."""
    duration: PositiveTime = 5.0
    """Time from the initial to the final value [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        done = np.clip((np.asarray(t, dtype=float) - self.start) / self.duration, 0.0, 1.0)
        # Both ends are met to the last digit, which `initial + (final - initial) * done` doesn't promise.
        return self.initial * (1.0 - done) + self.final * done

    @property
    def period(self) -> None:
        """There is none."""
        return None

    @property
    def shortest_change(self) -> float:
        """The duration of the ramp [s]."""
        return self.duration

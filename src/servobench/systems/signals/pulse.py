"""A single rectangular pulse; a train of them is a square wave with a duty below one half."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.settings import PositiveTime, Settings, Time
from servobench.systems.signals.base import SIGNALS, Level
from servobench.systems.signals.edges import is_past


@SIGNALS.member("pulse")
class Pulse(Settings):
    """`level` for start <= t < start + width, `rest` before and after; a pulse may go downwards."""

    rest: Level = 0.0
    """Value before and after the pulse [V]."""
    level: Level = 1.0
    """Value during the pulse [V]."""
    start: Time = 0.0
    """Time at which the pulse begins [s]."""
    width: PositiveTime = 0.5
    """Length of the pulse [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        during = is_past(t, self.start) & ~is_past(t, self.start + self.width)
        return np.where(during, self.level, self.rest)

    @property
    def period(self) -> None:
        """There is none."""
        return None

    @property
    def shortest_change(self) -> float:
        """The width [s]."""
        return self.width

"""A triangle wave, symmetric or not."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.settings import Angle, PositiveFrequency, Settings, Time
from servobench.systems.signals.base import SIGNALS, HighLevel, Level
from servobench.systems.signals.edges import periods


@SIGNALS.member("triangle")
class Triangle(Settings):
    """From `low` to `high` in the fraction `rise` of a period, and back in the rest; `low` before `start`.

    With phase 0 it leaves `low` at `start`. A rise of 0 is a falling sawtooth.
    """

    low: Level = -3.0
    """Lower value [V]."""
    high: HighLevel = 3.0
    """Upper value [V]."""
    frequency: PositiveFrequency = 0.4
    """Periods in a second [Hz]."""
    phase: Angle = 0.0
    """How far into its period the wave is at `start`; a period is 360 deg [rad]."""
    rise: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = 0.5
    """Fraction of the period in which it rises, from 0 to 1."""
    start: Time = 0.0
    """Time at which the wave begins [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        at = periods(t, self.frequency, self.start, self.phase)
        rising = at.fraction / self.rise if self.rise > 0 else np.inf
        falling = (1 - at.fraction) / (1 - self.rise) if self.rise < 1 else np.inf
        height = np.clip(np.minimum(rising, falling), 0.0, 1.0)
        return np.where(at.started, self.low * (1 - height) + self.high * height, self.low)

    @property
    def period(self) -> float:
        """The inverse of the frequency [s]."""
        return 1 / self.frequency

    @property
    def shortest_change(self) -> float:
        """The shorter of the times in which it rises and falls [s]; the period where one of them is zero."""
        return (min(self.rise, 1 - self.rise) or 1.0) * self.period

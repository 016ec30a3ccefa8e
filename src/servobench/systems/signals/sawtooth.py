"""A sawtooth wave."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.settings import Angle, PositiveFrequency, Settings, Time
from servobench.systems.signals.base import SIGNALS, HighLevel, Level
from servobench.systems.signals.edges import periods


@SIGNALS.member("sawtooth")
class Sawtooth(Settings):
    """From `low` to `high` in a period, and back at once; `low` before `start`.

    A falling sawtooth is a triangle whose rise is 0.
    """

    low: Level = 0.0
    """Lower value [V]."""
    high: HighLevel = 3.0
    """Upper value, which it only approaches [V]."""
    frequency: PositiveFrequency = 0.4
    """Periods in a second [Hz]."""
    phase: Angle = 0.0
    """How far into its period the wave is at `start`; a period is 360 deg [rad]."""
    start: Time = 0.0
    """Time at which the wave begins [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        at = periods(t, self.frequency, self.start, self.phase)
        return np.where(at.started, self.low * (1 - at.fraction) + self.high * at.fraction, self.low)

    @property
    def period(self) -> float:
        """The inverse of the frequency [s]."""
        return 1 / self.frequency

    @property
    def shortest_change(self) -> float:
        """The period [s]."""
        return self.period

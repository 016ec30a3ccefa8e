"""A sine wave."""

from __future__ import annotations

import math

import numpy as np

from servobench.core.channels import Array
from servobench.core.settings import Angle, PositiveFrequency, Settings, Time
from servobench.systems.signals.base import SIGNALS, Amplitude, Level
from servobench.systems.signals.edges import is_past


@SIGNALS.member("sine")
class Sine(Settings):
    """offset + amplitude · sin(2π f (t - start) + phase); `offset` before `start`.

    >>> import numpy as np
    >>> Sine(amplitude=2, frequency="1 Hz")(np.array([0.0, 0.25])).round(6)
    array([0., 2.])
    """

    amplitude: Amplitude = 1.0
    """Largest departure from the offset [V]."""
    offset: Level = 0.0
    """Mean value [V]."""
    frequency: PositiveFrequency = 0.4
    """Periods in a second [Hz]."""
    phase: Angle = 0.0
    """Phase at `start` [rad]."""
    start: Time = 0.0
    """Time at which the wave begins [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        cycles = self.frequency * (np.asarray(t, dtype=float) - self.start)
        wave = np.sin(2 * math.pi * (cycles - np.floor(cycles)) + self.phase)
        return np.where(is_past(t, self.start), self.offset + self.amplitude * wave, self.offset)

    @property
    def period(self) -> float:
        """The inverse of the frequency [s]."""
        return 1 / self.frequency

    @property
    def shortest_change(self) -> float:
        """Half a period [s]."""
        return self.period / 2

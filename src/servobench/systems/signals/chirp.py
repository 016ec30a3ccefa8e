"""A sine whose frequency changes at a constant rate."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.settings import Angle, Frequency, PositiveFrequency, PositiveTime, Settings, Time
from servobench.systems.signals.base import SIGNALS, Amplitude, Level
from servobench.systems.signals.edges import periods


@SIGNALS.member("chirp")
class Chirp(Settings):
    """offset + amplitude · sin(2π (f₀ τ + (f₁ - f₀) τ² / 2T) + phase), τ the time since the sweep began, T its length.

    The sweep repeats after T; before `start` the value is `offset`.

    >>> import numpy as np
    >>> Chirp(amplitude=2, initial_frequency="1 Hz")(np.array([0.0, 0.25])).round(1)
    array([0., 2.])
    """

    amplitude: Amplitude = 2.0
    """Largest departure from the offset [V]."""
    offset: Level = 0.0
    """Value about which it swings [V]."""
    initial_frequency: Annotated[Frequency, Field(ge=0)] = 0.1
    """Frequency f₀ at the beginning of a sweep [Hz]."""
    final_frequency: PositiveFrequency = 10.0
    """Frequency f₁ at the end of a sweep; it may be the lower one [Hz]."""
    sweep_time: PositiveTime = 10.0
    """Length T of a sweep [s]."""
    phase: Angle = 0.0
    """Phase at the beginning of a sweep [rad]."""
    start: Time = 0.0
    """Time at which the first sweep begins [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        at = periods(t, 1 / self.sweep_time, self.start)
        tau = at.fraction * self.sweep_time
        mean_frequency = (
            self.initial_frequency + (self.final_frequency - self.initial_frequency) * at.fraction / 2
        )
        wave = np.sin(2 * math.pi * mean_frequency * tau + self.phase)
        return np.where(at.started, self.offset + self.amplitude * wave, self.offset)

    @property
    def period(self) -> float:
        """The length of a sweep [s]."""
        return self.sweep_time

    @property
    def shortest_change(self) -> float:
        """Half a period of the higher of the two frequencies [s]."""
        return 0.5 / max(self.initial_frequency, self.final_frequency)

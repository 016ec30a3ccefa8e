"""The sensors: incremental encoder, current sense and tachometer."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from servobench.core.settings import CountsPerRev, Current, Settings, Speed


class Encoder(Settings):
    """An incremental encoder read in quadrature by a counter that wraps.

    counts = floor(θ counts_per_rev / 2π), as a signed number of `counter_bits` bits; four counts for each line
    of the disc (section II.B of the paper).
    """

    counts_per_rev: CountsPerRev = 2048.0
    """Counts in a revolution: four times the lines of the disc."""
    counter_bits: Literal[16, 24, 32] = 24
    """Width of the counter; it wraps from its largest to its smallest number."""

    def counts(self, angle: float) -> int:
        """Return what the counter shows at a shaft angle [rad]."""
        whole = math.floor(angle * self.counts_per_rev / (2 * math.pi))
        half = 1 << (self.counter_bits - 1)
        return (whole + half) % (2 * half) - half


class CurrentSensor(Settings):
    """An analog current channel: noise, then a converter of `bits` bits over ±range."""

    range: Current = 3.0
    """Largest current that it can show [A]."""
    bits: int = 12
    """Resolution of the converter."""
    noise: Current = 0.0
    """Standard deviation of its white noise, before the converter [A]."""

    @property
    def resolution(self) -> float:
        """The smallest step [A]."""
        return float(2 * self.range / 2**self.bits)

    def read(self, current: float, random: np.random.Generator) -> float:
        """Return what the channel shows for a current [A]."""
        value = current + (random.normal(0.0, self.noise) if self.noise else 0.0)
        return float(max(-self.range, min(self.range, round(value / self.resolution) * self.resolution)))


class Tachometer(Settings):
    """A speed channel of the drive: the shaft's speed in steps of `resolution`, with white noise."""

    resolution: Speed = 2 * math.pi / 2048
    """Smallest step, by default one count a second [rad/s]."""
    noise: Speed = 0.0
    """Standard deviation of its white noise [rad/s]."""

    def read(self, speed: float, random: np.random.Generator) -> float:
        """Return what the channel shows for a speed [rad/s]."""
        value = speed + (random.normal(0.0, self.noise) if self.noise else 0.0)
        return float(round(value / self.resolution) * self.resolution if self.resolution > 0 else value)

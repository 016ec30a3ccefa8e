"""A device's measurements: its channels, one reading of all of them (a sample), and its description."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Timing: TypeAlias = Literal["virtual", "host", "device"]


LARGEST_VALUE = 1e30
"""The largest value of a channel, in any unit: 64-bit counters end at 1.8e19, and powers of it stay within a float."""

SMALLEST_VALUE = 1e-30
"""Smaller values count as zero: no sensor resolves them."""

SHORTEST_STEP, LONGEST_STEP = 1e-9, 1e6
"""Between these lies the sample time of any motor [s]."""


def measurable(x: Array) -> Array:
    """Return values x (N,) as a channel can have them: NaN beyond `LARGEST_VALUE`, zero below `SMALLEST_VALUE`."""
    size = np.abs(x)
    if (size <= LARGEST_VALUE).all() and ((size >= SMALLEST_VALUE) | (size == 0.0)).all():
        return x
    return np.where(size < SMALLEST_VALUE, 0.0, np.where(size <= LARGEST_VALUE, x, np.nan))


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One thing that is measured or commanded.

    `unit` is None where a file doesn't say it. `minimum` and `maximum` bound the range, `resolution` is the smallest
    step, all three in `unit`. An encoder has `counter_bits`, the width at which it wraps, and `counts_per_rev`. `travel_per_rev`
    is by how much a revolution moves what the user thinks of, with its unit, such as `0.48 m` of a wheel; None for an angle.
    """

    name: str
    """Its name, such as `counts`."""
    unit: str | None
    minimum: float | None = None
    maximum: float | None = None
    resolution: float | None = None
    counter_bits: int | None = None
    counts_per_rev: float | None = None
    travel_per_rev: str | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Sample:
    """One latch of a device's inputs, taken before the voltage of the same tick acts.

    `index` counts ticks from 0, `time` is the device's or the clock's own time of the latch [s], `counts` the encoder as the
    counter shows it (wrapped). `tachometer` [rad/s] and `current` [A] are there where the device has them, and so is `held_since`
    [s]: when the voltage that it puts out at the latch began to hold, by a device that keeps the time, in the count of `time`.
    """

    index: int
    time: float
    counts: int
    tachometer: float | None = None
    current: float | None = None
    held_since: float | None = None


@dataclass(frozen=True, kw_only=True)
class DeviceInfo:
    """A device's description: its name, serial number, channels, and its delay from a write to the shaft [s].

    `timing` says who keeps the time: the caller's virtual clock, the host's clock, or the device itself.
    `settings` are the settings it was opened with, for the record.
    """

    name: str
    serial: str = ""
    channels: tuple[Channel, ...] = ()
    delay: float = 0.0
    timing: Timing = "virtual"
    settings: tuple[tuple[str, str], ...] = field(default=())

    def channel(self, name: str) -> Channel | None:
        """Return the channel of that name, or None where the device hasn't one."""
        return next((channel for channel in self.channels if channel.name == name), None)

    def with_limit(self, voltage: float) -> Self:
        """Return the same device with its voltage also limited to ±`voltage` [V], which is what a controller gets to know."""
        channels = tuple(
            replace(
                channel,
                minimum=-voltage if channel.minimum is None else max(channel.minimum, -voltage),
                maximum=voltage if channel.maximum is None else min(channel.maximum, voltage),
            )
            if channel.name == "voltage"
            else channel
            for channel in self.channels
        )
        return replace(self, channels=channels)

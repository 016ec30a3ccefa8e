"""Time that is computed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

from servobench.core.channels import Sample, Timing
from servobench.rig.clock.base import Tick
from servobench.rig.clock.device import DeviceClock


class VirtualClock:
    """Time that passes as fast as it is computed, and is the same to the bit every time: tick k is at k times the sample time.

    The samples say which tick it is and what time: a simulated device may leave some out, or latch them late.
    """

    timing: ClassVar[Timing] = "virtual"

    ALLOWED_LATENESS: ClassVar[float] = 0.1
    """By which part of the sample time a simulated device may latch a sample late without the tick being late."""

    def __init__(self) -> None:
        self._device = DeviceClock()
        self._sample_time = self._now = math.nan

    def start(self, sample_time: float) -> None:
        """Begin at tick 0."""
        self._sample_time = sample_time
        self._device.start(sample_time)

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Latch at once; raises `DeviceError` as the device's own clock does."""
        tick = self._device.latch(index, read)
        self._now = tick.actual
        lateness = tick.actual - tick.scheduled
        return replace(tick, late=True) if lateness > self.ALLOWED_LATENESS * self._sample_time else tick

    def pass_to(self, tick: Tick) -> None:
        """Go on to a tick that is done, with those before it, all in time."""
        self._device.pass_to(tick)
        self._now = tick.actual

    def elapsed(self) -> float:
        """Return the time of the last tick: nothing takes time."""
        return self._now

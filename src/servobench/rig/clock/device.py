"""The time that a device keeps itself."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import ClassVar

from servobench.core.channels import Sample, Timing
from servobench.core.errors import DeviceError
from servobench.rig.clock.base import Tick


class DeviceClock:
    """The device's own time: its `read` waits for the tick, and its samples carry their number and time.

    No sample is late by the clock that makes it; those whose number is left out are missed. `now` [s] puts another time in the
    place of the host's monotonic one, which `elapsed` tells.
    """

    timing: ClassVar[Timing] = "device"

    def __init__(self, *, now: Callable[[], float] = time.perf_counter) -> None:
        self._now = now
        self._began = now()
        self._sample_time = math.nan
        self._first: int | None = None
        self._before = -math.inf

    def start(self, sample_time: float) -> None:
        """Begin at the device's next sample, which is tick 0."""
        self._began = self._now()
        self._sample_time = sample_time
        self._first = None
        self._before = -math.inf

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Take the device's next sample; raises `DeviceError` where its number or its time is no higher than the one before."""
        sample = read()
        if self._first is None:
            self._first = sample.index - index
        number = sample.index - self._first
        if number < index:
            raise DeviceError(
                f"the device sent sample {sample.index} where {index + self._first} or a later one was due: its "
                "samples are out of order"
            )
        # Not "<=", which lets NaN through.
        if not self._before < sample.time < math.inf:
            raise DeviceError(
                f"the device sent sample {sample.index} with the time {sample.time:.9g} s after one with "
                f"{self._before:.9g} s: its clock stopped or went back, so the times of the samples aren't known"
            )
        self._before = sample.time
        return Tick(
            index=number,
            scheduled=number * self._sample_time,
            actual=sample.time,
            late=False,
            sample=sample,
        )

    def pass_to(self, tick: Tick) -> None:
        """Take note of a sample that somebody else took."""
        self._before = tick.actual

    def elapsed(self) -> float:
        """Return the host's time since the start [s]: the device says its own with its samples, and not in between."""
        return self._now() - self._began

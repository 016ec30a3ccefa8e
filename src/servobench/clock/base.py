"""Clocks: who keeps the time of a run. A clock waits for each tick and latches its sample."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

from servobench.channels import Sample, Timing
from servobench.errors import DeviceError


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """One tick and its sample.

    `scheduled` is `index` times the sample time [s], `actual` when the sample was latched [s], in the clock's own count.
    A tick is `late` where that was after the schedule by more than is allowed, or where whole ticks before it were missed.
    """

    index: int
    scheduled: float
    actual: float
    late: bool
    sample: Sample


@runtime_checkable
class Clock(Protocol):
    """Keeps the time of one run at a time."""

    timing: ClassVar[Timing]
    """Whose time it is; a run takes it for the devices that say the same of themselves, and any for a virtual one."""

    def start(self, sample_time: float) -> None:
        """Begin a run of ticks of that length [s]; tick 0 is now or soon."""
        ...

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Wait for the tick of that index, latch its sample by calling `read`, and return both.

        Where whole ticks have gone by already, they are missed, and the tick that comes back is a later one.
        """
        ...


class VirtualClock:
    """Time that passes as fast as it is computed, and is the same to the bit every time: tick k is at k times the sample time."""

    timing: ClassVar[Timing] = "virtual"

    def __init__(self) -> None:
        self._sample_time = math.nan

    def start(self, sample_time: float) -> None:
        """Begin at tick 0."""
        self._sample_time = sample_time

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Latch at once."""
        now = index * self._sample_time
        return Tick(index=index, scheduled=now, actual=now, late=False, sample=read())


class HostClock:
    """The computer's time: sleeps until shortly before each deadline, and spins for the rest.

    Deadlines are counted from the start, so that lateness of one tick doesn't move the next. What comes late by less than a
    tick is done at once; whole ticks that have gone by are skipped, never made up for in a burst, as the motor would see their
    voltages for no time at all. A tick is late from a tenth of the sample time on.

    `now` tells the time [s] and never goes back, `sleep` waits for some time [s], and may take longer.
    """

    timing: ClassVar[Timing] = "host"

    # The wake-up from a sleep is 75 µs late in the median and 0.7 ms in one of a hundred, on Linux without real-time
    # scheduling; the spin takes the median away. It costs a part of a processor, and where scheduling is real-time, a
    # process that never sleeps is put to sleep by force; hence its two limits.
    LONGEST_SPIN: ClassVar[float] = 150e-6  # s
    LARGEST_SPIN: ClassVar[float] = 0.2  # of the sample time
    ALLOWED_LATENESS: ClassVar[float] = 0.1  # of the sample time
    LEAD_TICKS: ClassVar[int] = 5  # before tick 0, so that what is slow the first time isn't late
    LONGEST_LEAD: ClassVar[float] = 0.05  # s

    def __init__(
        self, *, now: Callable[[], float] = time.perf_counter, sleep: Callable[[float], object] = time.sleep
    ) -> None:
        self._now = now
        self._sleep = sleep
        self._sample_time = self._spin = self._origin = math.nan

    def start(self, sample_time: float) -> None:
        """Begin; tick 0 is a few ticks ahead."""
        self._sample_time = sample_time
        self._spin = min(self.LONGEST_SPIN, self.LARGEST_SPIN * sample_time)
        self._origin = self._now() + min(self.LEAD_TICKS * sample_time, self.LONGEST_LEAD)

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Wait until the tick's deadline, then latch; the actual time is that of the call."""
        scheduled = index * self._sample_time
        self._wait_until(self._origin + scheduled)
        actual = self._now() - self._origin
        # Not below 0: the time waited for may differ from its own schedule in the last bit.
        missed = max(0, int((actual - scheduled) // self._sample_time))
        scheduled = (index + missed) * self._sample_time
        late = missed > 0 or actual - scheduled > self.ALLOWED_LATENESS * self._sample_time
        return Tick(index=index + missed, scheduled=scheduled, actual=actual, late=late, sample=read())

    def _wait_until(self, deadline: float) -> None:
        while (rest := deadline - self._now()) > self._spin:
            self._sleep(rest - self._spin)
        while self._now() < deadline:
            pass


class DeviceClock:
    """The device's own time: its `read` waits for the tick, and its samples carry their number and time.

    No sample is late by the clock that makes it; those whose number is left out are missed.
    """

    timing: ClassVar[Timing] = "device"

    def __init__(self) -> None:
        self._sample_time = math.nan
        self._first: int | None = None

    def start(self, sample_time: float) -> None:
        """Begin at the device's next sample, which is tick 0."""
        self._sample_time = sample_time
        self._first = None

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Take the device's next sample; raises `DeviceError` where its number is no higher than the one before."""
        sample = read()
        if self._first is None:
            self._first = sample.index - index
        found = sample.index - self._first
        if found < index:
            raise DeviceError(
                f"the device sent sample {sample.index} where {index + self._first} or a later one was due: "
                f"its samples don't come in order"
            )
        return Tick(
            index=found,
            scheduled=found * self._sample_time,
            actual=sample.time,
            late=False,
            sample=sample,
        )


def clock_for(timing: Timing) -> Clock:
    """Return a clock for a device that leaves the time to the caller (`virtual`), to the host, or keeps it itself."""
    clocks: dict[Timing, type[Clock]] = {"virtual": VirtualClock, "host": HostClock, "device": DeviceClock}
    return clocks[timing]()

"""Two ways to wait for a deadline on the host: compiled on Linux, and with `time.sleep` everywhere else.

Both sleep until shortly before it and spin for the rest: a wake-up from a sleep is some ten microseconds late where scheduling
is real-time, and 75 µs in the median and 0.7 ms in one of a hundred where it isn't. Spinning costs processor time, and the
system suspends a real-time process that never sleeps: hence its limits.
"""

from __future__ import annotations

import errno
import os
import sys
import time
from collections.abc import Callable
from types import FunctionType
from typing import Protocol

SHORTEST_SPIN = 20_000  # ns
FIRST_SPIN = 60_000  # ns
LONGEST_SPIN = 150_000  # ns
LARGEST_SPIN = 0.2  # of the sample time


class Waiting(Protocol):
    """Waits for deadlines; its times [ns] count from any moment and never go back."""

    def start(self, sample_time: float) -> None:
        """Begin a run of ticks of that length [s]."""
        ...

    def now(self) -> int:
        """Return the time [ns]."""
        ...

    def until(self, deadline: int) -> int:
        """Wait until a time [ns], not at all where it is over, and return the time then [ns]."""
        ...

    def sleep_until(self, deadline: int) -> int:
        """As `until`, but without spinning: what comes back tells how late the system wakes a process."""
        ...


class Spin:
    """The time before a deadline at which a sleep ends: the lateness that 997 of 1,000 wake-ups keep within.

    That quantile q is followed by stochastic approximation (Robbins and Monro 1951): a wake-up later than q moves it up by 0.997
    steps, any other down by 0.003 steps, so that it comes to rest where three of a thousand are later. With 99 of 100 the 99th
    percentile of the lateness would stand where it jumps from nothing to all of a wake-up's. It stays between 20 and 150 µs, and
    is no longer than a fifth of the sample time, whichever is less.
    """

    SHARE = 0.997  # of the wake-ups
    STEP = 5_000  # ns: 100 µs less within 6,700 ticks, 100 µs more within 20 late ones

    def __init__(self, sample_time: float) -> None:
        self._most = min(LONGEST_SPIN, int(LARGEST_SPIN * sample_time * 1e9))
        self._least = min(SHORTEST_SPIN, self._most)
        self._late = float(FIRST_SPIN)

    @property
    def length(self) -> int:
        """The spin of the next tick [ns]."""
        return max(self._least, min(self._most, int(self._late)))

    def learn(self, over: int) -> None:
        """Take note of a wake-up that was late by so much [ns]."""
        moved = self._late + (self.SHARE if over > self._late else self.SHARE - 1) * self.STEP
        # Not beyond the limits, or it would need as long to come back.
        self._late = max(self._least, min(self._most, moved))


class CompiledWaiting:
    """Absolute deadlines of the system, slept for and spun in machine code; on Linux."""

    def __init__(self) -> None:
        import numpy as np

        from servobench.rig.clock import kernels

        self._kernels = kernels
        self._timespec = np.zeros(2, dtype=np.int64)
        self._spin = Spin(1.0)
        # Compiled, or read from disk, now rather than in the first tick.
        self.until(self.now() + FIRST_SPIN)

    @staticmethod
    def possible() -> bool:
        """Whether this system has what it takes, in the layout that the kernel expects."""
        if not sys.platform.startswith("linux") or sys.maxsize < 2**32:
            return False
        from servobench.rig.clock import kernels

        # As plain Python, where Numba is switched off, it can't call the system.
        return not isinstance(kernels.wait_until, FunctionType)

    def start(self, sample_time: float) -> None:
        """Begin with the spin that is usual."""
        self._spin = Spin(sample_time)

    def now(self) -> int:
        """Return the time [ns]."""
        return int(self._kernels.now(self._timespec))

    def until(self, deadline: int) -> int:
        """Sleep, and spin as long as wake-ups were late of late."""
        return self._wait(deadline, self._spin.length, self._spin.learn)

    def sleep_until(self, deadline: int) -> int:
        """Sleep alone."""
        return self._wait(deadline, 0, lambda over: None)

    def _wait(self, deadline: int, spin: int, learn: Callable[[int], None]) -> int:
        while True:
            now, over, error = self._kernels.wait_until(deadline, spin, self._timespec)
            if error not in (0, errno.EINTR):
                raise OSError(error, os.strerror(error))
            if over >= 0:
                learn(over)
            if now >= deadline:
                return int(now)
            # A signal: Python looks at it between two lines, and raises KeyboardInterrupt where it was Ctrl-C.


class SleepWaiting:
    """`time.sleep` and a spin of a fixed length, wherever Python runs.

    `now` tells the time [s] and never goes back, `sleep` waits for some time [s], and may take longer or be over early.
    """

    def __init__(self, now: Callable[[], float], sleep: Callable[[float], object]) -> None:
        self._now = now
        self._sleep = sleep
        self._spin = LONGEST_SPIN

    def start(self, sample_time: float) -> None:
        """Begin with the longest spin, as sleeps are coarse where nothing better is known."""
        self._spin = min(LONGEST_SPIN, int(LARGEST_SPIN * sample_time * 1e9))

    def now(self) -> int:
        """Return the time [ns]."""
        return round(self._now() * 1e9)

    def until(self, deadline: int) -> int:
        """Sleep, as often as it takes, and spin."""
        self.sleep_until(deadline - self._spin)
        while (now := self.now()) < deadline:
            pass
        return now

    def sleep_until(self, deadline: int) -> int:
        """Sleep alone, as often as it takes."""
        while (rest := deadline - (now := self.now())) > 0:
            self._sleep(rest / 1e9)
        return now


def make_waiting(now: Callable[[], float] | None, sleep: Callable[[float], object] | None) -> Waiting:
    """Return the best that this system has, or one by the time that is given."""
    if now is None and sleep is None and CompiledWaiting.possible():
        return CompiledWaiting()
    return SleepWaiting(now or time.perf_counter, sleep or time.sleep)

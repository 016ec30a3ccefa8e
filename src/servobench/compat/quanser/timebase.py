"""The time of the stand-in: simulated, where waits take none, or paced by the wall clock."""

from __future__ import annotations

import math
import threading
import time

CALL = 125e-6
"""The simulated time that an immediate call takes: a microframe of USB [s]."""

LOOK = 2e-6
"""The simulated time that reading the clock takes, so that a loop that polls it ends [s]."""

# Kept here, as the names in `time` may be replaced when they are needed.
_wall, _sleep, _epoch = time.perf_counter, time.sleep, time.time


class Timebase:
    """The time since the stand-in was installed [s].

    Simulated time stands still unless it is spent or waited for. It is paced by the wall clock as soon as the program has a
    second thread, unless threads are ignored: it is unknown what a thread that isn't waiting is doing.
    """

    def __init__(self, *, paced: bool, ignore_threads: bool = False) -> None:
        self._now = 0.0
        self._paced = paced
        self._lock = threading.RLock()
        self._threads = math.inf if ignore_threads else threading.active_count()
        self._offset = -_wall()
        self.began = _epoch()

    @property
    def paced(self) -> bool:
        """Whether the wall clock sets the pace."""
        return self._paced

    def now(self) -> float:
        """Return the time [s]; asking costs nothing."""
        with self._lock:
            return self._offset + _wall() if self._paced else self._now

    def spend(self, duration: float) -> float:
        """Let a call cost its time [s], and return the time after it."""
        with self._lock:
            self._take_part()
            if not self._paced:
                self._now += duration
            return self.now()

    def wait_until(self, moment: float) -> float:
        """Wait until a time [s], and return the time then; one that has passed is now."""
        with self._lock:
            self._take_part()
            if not self._paced:
                self._now = max(self._now, moment)
                return self._now
        while (left := moment - self.now()) > 0.0:
            _sleep(left)
        return self.now()

    def _take_part(self) -> None:
        """Notice a thread that was started since."""
        if not self._paced and threading.active_count() > self._threads:
            self._offset, self._paced = self._now - _wall(), True

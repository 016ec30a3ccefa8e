"""The time of the stand-in: simulated, where waits take none, or paced by the wall clock."""

from __future__ import annotations

import math
import sysconfig
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from sys import _getframe
from typing import Any

CALL = 125e-6
"""What an immediate call costs in simulated time: a microframe of USB [s]."""

LOOK = 2e-6
"""What a look at the clock costs in simulated time, so that a loop that polls it ends [s]."""

_OWN = str(Path(__file__).parents[2])  # servobench itself, wherever it is installed

# Kept here, as the names in `time` may be replaced when they are needed.
_wall, _sleep, _epoch = time.perf_counter, time.sleep, time.time


class Timebase:
    """The time since the stand-in was installed [s].

    Simulated time stands still unless it is spent or waited for. It is paced by the wall clock as soon as the program has a
    second thread, unless threads are ignored: nobody can tell what a thread that isn't waiting is doing.
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


class ReplacedTime:
    """The functions of `time` while simulated time is in force, for the program and its own modules.

    The standard library and installed packages keep the real ones, as they wait by means that aren't replaced.
    """

    def __init__(self, timebase: Timebase) -> None:
        self._timebase = timebase
        self._kept: dict[str, Callable[..., Any]] = {}

    def __enter__(self) -> ReplacedTime:
        for name, began in (("time", self._timebase.began), ("perf_counter", 0.0), ("monotonic", 0.0)):
            self._replace(name, self._clock(began, 1))
            self._replace(f"{name}_ns", self._clock(began, 10**9))
        self._replace("sleep", self._sleep_in_simulation)
        return self

    def __exit__(self, *ending: object) -> None:
        for name, function in self._kept.items():
            setattr(time, name, function)

    def _replace(self, name: str, simulated: Callable[..., Any]) -> None:
        real = self._kept[name] = getattr(time, name)

        def function(*arguments: Any) -> Any:
            return (real if is_installed(_getframe(1).f_code.co_filename) else simulated)(*arguments)

        function.__name__ = name
        setattr(time, name, function)

    def _clock(self, began: float, per_second: int) -> Callable[[], float]:
        def look() -> float:
            now = began + self._timebase.spend(LOOK)
            return int(now * per_second) if per_second > 1 else now

        return look

    def _sleep_in_simulation(self, duration: float) -> None:
        if duration < 0:
            raise ValueError("sleep length must be non-negative")
        self._timebase.wait_until(self._timebase.now() + duration)


@cache
def is_installed(file: str) -> bool:
    """Return whether a source file belongs to Python or to an installed package, and not to the program."""
    if file.startswith("<frozen"):
        return True
    folders = [sysconfig.get_paths()[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    return file.startswith((*folders, _OWN))

"""A program's waits: the functions that simulated time replaces, and the waits that it can't shorten."""

from __future__ import annotations

import builtins
import queue
import re
import sysconfig
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from sys import _getframe
from types import FrameType
from typing import Any

from servobench.compat.quanser import timebase as clock
from servobench.compat.quanser.timebase import LOOK, Timebase

_OWN = str(Path(__file__).parents[2])  # servobench itself, wherever it is installed
_PACKAGE = re.compile(r".*[\\/](?:site|dist)-packages[\\/][^\\/]+")
_PAUSE = 0.1  # s; a faster answer comes from a file or a pipe, and repeats itself only if that takes no time
_TOO_LONG, _MOST = 1.0, 0.9  # s, and the share of the wall clock that makes it a wait and not a computation

# Kept here, as the names in `time` are replaced later.
_cpu = time.process_time


class ReplacedTime:
    """The functions that wait or tell the time while simulated time is in force, for the program and its own modules.

    The standard library and installed packages keep the real ones, as they wait by means that aren't replaced; except for the
    packages that `follow` a program, as those that open a board do. `wait` lets a time pass [s].
    """

    def __init__(self, timebase: Timebase, wait: Callable[[float], None], idle: Idle) -> None:
        self._timebase, self._wait, self._idle = timebase, wait, idle
        self._kept: list[tuple[Any, str, Any]] = []
        self._following: set[str] = set()

    def __enter__(self) -> ReplacedTime:
        began = {"time": self._timebase.began, "perf_counter": 0.0, "monotonic": 0.0}
        for name in (*began, "process_time", "thread_time"):
            self._replace(name, self._clock(began.get(name, 0.0), 1))
            self._replace(f"{name}_ns", self._clock(began.get(name, 0.0), 10**9))
        for name, per_second in (("clock_gettime", 1), ("clock_gettime_ns", 10**9)):
            if hasattr(time, name):
                self._replace(name, self._clock_of(per_second))
        self._replace("sleep", self._sleep)
        self._put(threading.Condition, "wait", self._condition_wait(threading.Condition.wait))
        for module, name in ((threading, "_time"), (queue, "time")):
            self._put(module, name, self._clock_of_library(getattr(module, name)))
        self._put(builtins, "input", self._input(builtins.input))
        return self

    def __exit__(self, *ending: object) -> None:
        while self._kept:
            owner, name, function = self._kept.pop()
            setattr(owner, name, function)

    def follow(self, frame: FrameType | None) -> None:
        """Let the installed packages that are at work in a frame, and in those that called it, use simulated time, too."""
        while frame is not None:
            file = frame.f_code.co_filename
            if not file.startswith(_OWN) and (package := _PACKAGE.match(file)):
                self._following.add(package[0])
            frame = frame.f_back

    def _put(self, owner: Any, name: str, function: Any) -> None:
        self._kept.append((owner, name, getattr(owner, name)))
        setattr(owner, name, function)

    def _replace(self, name: str, simulated: Callable[..., Any]) -> None:
        real = getattr(time, name)

        def function(*arguments: Any) -> Any:
            file = _getframe(1).f_code.co_filename
            return (simulated if self._is_of_program(file) else real)(*arguments)

        function.__name__ = name
        self._put(time, name, function)

    def _is_of_program(self, file: str) -> bool:
        if not is_installed(file):
            return True
        package = _PACKAGE.match(file) if self._following else None
        return package is not None and package[0] in self._following

    def _is_alone(self) -> bool:
        """Whether nothing but its time-out can end a wait."""
        return not self._timebase.paced and threading.active_count() == 1

    def _clock(self, began: float, per_second: int) -> Callable[[], float]:
        def look() -> float:
            now = began + self._timebase.spend(LOOK)
            return int(now * per_second) if per_second > 1 else now

        return look

    def _clock_of(self, per_second: int) -> Callable[[int], float]:
        """The clocks of the operating system by their numbers."""
        real, other = self._clock(self._timebase.began, per_second), self._clock(0.0, per_second)
        return lambda number: real() if number == time.CLOCK_REALTIME else other()

    def _clock_of_library(self, real: Callable[[], float]) -> Callable[[], float]:
        """The clock by which a module of the standard library waits for a condition."""
        simulated = self._clock(0.0, 1)
        return lambda: (simulated if self._is_alone() else real)()

    def _sleep(self, duration: float) -> None:
        if duration < 0:
            raise ValueError("sleep length must be non-negative")
        self._wait(duration)

    def _condition_wait(self, real: Callable[..., bool]) -> Callable[..., bool]:
        """A wait for a condition, and so for an event or a queue: without another thread only the time can end it."""

        def wait(condition: Any, timeout: float | None = None) -> bool:
            if timeout is None or timeout <= 0.0 or not self._is_alone():
                return real(condition, timeout)
            state = condition._release_save()  # a signal's handler may notify meanwhile
            try:
                self._wait(timeout)
            finally:
                condition._acquire_restore(state)
            return False

        return wait

    def _input(self, real: Callable[..., str]) -> Callable[..., str]:
        """`input`, which takes the time of the person's answer, in whole tenths of a second."""

        def wait_for_line(*prompt: Any) -> str:
            began = clock._wall()
            try:
                return real(*prompt)
            finally:
                if not self._timebase.paced and (steps := (clock._wall() - began) // _PAUSE):
                    self._wait(steps * _PAUSE)
                self._idle.begin()

        wait_for_line.__name__ = "input"
        return wait_for_line


class Idle:
    """The time that goes by on the wall clock alone between calls to a board while the motor is driven [s].

    Where nearly all of it was neither simulated nor computed in, the program waited by means that aren't replaced, and its
    numbers are wrong: `say` tells that, once.
    """

    def __init__(self, timebase: Timebase, say: Callable[[str], None]) -> None:
        self._timebase, self._say = timebase, say
        self._wall = self._computed = 0.0
        self._began: tuple[float, float] | None = None
        self._reported = False

    def begin(self) -> None:
        """Begin to count: a call has ended."""
        self._began = (clock._wall(), _cpu())

    def end(self, *, driven: bool) -> None:
        """Count what went by until a call."""
        if self._began is None or not driven or self._reported or self._timebase.paced:
            return
        self._wall += clock._wall() - self._began[0]
        self._computed += _cpu() - self._began[1]
        waited = self._wall - self._computed
        if waited > max(_TOO_LONG, _MOST * self._wall):
            self._reported = True
            self._say(
                f"{waited:.1f} s went by while the motor was driven, and simulated time stood still: the program waits by other "
                "means than time.sleep. Its numbers are right in real time only."
            )


@cache
def is_installed(file: str) -> bool:
    """Return whether a source file belongs to Python or to an installed package, and not to the program."""
    if file.startswith("<frozen") or _PACKAGE.match(file):
        return True
    folders = [sysconfig.get_paths()[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    # The scheduler waits by the functions that the program gives it.
    return file.startswith((*folders, _OWN)) and Path(file).name != "sched.py"

"""Waiting for a deadline on Linux, compiled: the last look at the clock is some ten nanoseconds before the tick."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

import numba
import numpy as np
from numpy.typing import NDArray

from servobench.core.compiled import compiled

_MONOTONIC = 1  # CLOCK_MONOTONIC, linux/time.h; the clock of time.perf_counter, too
_ABSOLUTE = 1  # TIMER_ABSTIME

# By name rather than by address, so that the machine code can be kept on disk. A pointer is passed as a number.
_types = cast(Any, numba.types)
_clock_gettime: Callable[[int, int], int] = _types.ExternalFunction(
    "clock_gettime", _types.int32(_types.int32, _types.uintp)
)
_clock_nanosleep: Callable[[int, int, int, int], int] = _types.ExternalFunction(
    "clock_nanosleep", _types.int32(_types.int32, _types.int32, _types.uintp, _types.uintp)
)


@compiled
def now(timespec: NDArray[np.int64]) -> int:
    """Return the time [ns]; `timespec` (2,) is room for seconds and nanoseconds, as the system has them."""
    _clock_gettime(_MONOTONIC, timespec.ctypes.data)
    seconds: int = timespec[0]
    nanoseconds: int = timespec[1]
    return seconds * 1_000_000_000 + nanoseconds


@compiled
def wait_until(deadline: int, spin: int, timespec: NDArray[np.int64]) -> tuple[int, int, int]:
    """Sleep until `spin` before a deadline, look at the clock until it's there; both are in ns.

    `timespec` (2,) is room for the time that is slept for, as the system has it: whole seconds and the ns behind them.
    Returns the time [ns] at the last look, how long after the time that was slept for it was when the sleep ended [ns], or -1
    where there was no time to sleep, and the system's error number. With an error (such as a signal, which Python has to see),
    the deadline may not be reached yet.
    """
    time = now(timespec)
    wake = deadline - spin
    over = -1
    if time < wake:
        timespec[0] = wake // 1_000_000_000
        timespec[1] = wake % 1_000_000_000
        error = _clock_nanosleep(_MONOTONIC, _ABSOLUTE, timespec.ctypes.data, 0)
        time = now(timespec)
        if error != 0:
            return time, -1, error
        over = time - wake
    while time < deadline:
        time = now(timespec)
    return time, over, 0

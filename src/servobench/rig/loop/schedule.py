"""Real-time scheduling of the loop's process: what was granted, and what was denied and why."""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info, list_text

PRIORITY = 80  # of 99; the kernel's own threads for interrupts have 50, so that the loop comes before them
_PR_SET_TIMERSLACK = 29  # linux/prctl.h
_MCL_CURRENT, _MCL_FUTURE = 1, 2  # sys/mman.h
_CAP_IPC_LOCK = 14  # linux/capability.h
# The kernel stops real-time processes for the rest of each second (by default after 95 % of it) where they don't rest by
# themselves. A tick spins for a fifth of its time and works for less than another: below this share it could be stopped.
_SMALLEST_SHARE = 0.5

HOW_TO_PERMIT = (
    "to permit it on Linux, give your user the lines `NAME - rtprio 99` and `NAME - memlock unlimited` in a file in "
    "/etc/security/limits.d and log in again, or give the process the capabilities CAP_SYS_NICE and CAP_IPC_LOCK"
)
ELSEWHERE = "Windows and macOS have no real-time scheduling here, and run without it"


class _Denied(Exception):
    """A thing that isn't permitted here; the text says why."""


@dataclass(frozen=True, kw_only=True)
class Scheduling:
    """The real-time privileges granted and denied, with reasons; one short phrase for each."""

    granted: tuple[str, ...] = ()
    denied: tuple[str, ...] = ()

    def findings(self) -> tuple[Finding, ...]:
        """Return what to know of it: one info, which says how to permit what was denied."""
        if not self.denied:
            return (info("real-time", f"The loop ran with {list_text(self.granted)}."),)
        ran = f"with {list_text(self.granted)} and " if self.granted else ""
        advice = HOW_TO_PERMIT if sys.platform == "linux" else ELSEWHERE
        return (
            info(
                "real-time-denied",
                f"The loop ran {ran}without {list_text(self.denied)}, so samples may be late more often; {advice}.",
            ),
        )


def real_time(*, priority: int = PRIORITY, cpu: int | None = None) -> Scheduling:
    """Make the process that calls it as punctual as it may be, and return what was granted and what denied.

    In this order: the garbage collector looks at what there is a last time and is switched off; timers ring to the nanosecond
    rather than within 50 µs; the process stays on one processor, `cpu`, or else the last of those that it may use (interrupts
    are mostly served by the first); its memory stays in place (mlockall); and it goes before all others (SCHED_FIFO at
    `priority`, from 1 to 99, or the highest that is permitted). What isn't permitted is left out and reported.

    There is no way back: it is meant for a process that ends with its run. What it starts later is scheduled as usual.
    A process with real-time priority must rest in each of its ticks, as a computer with few processors hangs otherwise; and
    whoever doesn't is stopped by the kernel for a part of each second (sched_rt_runtime_us). `HostClock` spins for no more
    than a fifth of a tick.

    Raises `UsageError` for a priority or a processor that can't be.
    """
    if not 1 <= priority <= 99:
        raise UsageError(f"a real-time priority of {priority} isn't possible; expected 1 to 99")
    _freeze_garbage()
    granted, denied = ["garbage collection switched off"], []
    steps: tuple[tuple[str, Callable[[], str]], ...] = (
        ("nanosecond timers", _exact_timers),
        ("a processor of its own", lambda: _stay_on(cpu)),
        ("memory locked", _lock_memory),
        ("real-time priority", lambda: _go_first(priority)),
    )
    for name, step in steps:
        try:
            granted.append(step())
        except _Denied as reason:
            denied.append(f"{name} ({reason})")
    return Scheduling(granted=tuple(granted), denied=tuple(denied))


def _freeze_garbage() -> None:
    """Freeze the garbage collector's objects; nothing in a tick makes cycles, so that nothing accumulates."""
    gc.collect()
    gc.freeze()
    gc.disable()


def _exact_timers() -> str:
    if sys.platform != "linux":
        raise _Denied("there is no such setting on this system")
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(1), 0, 0, 0) != 0:
        raise _Denied(_last_error())
    return "nanosecond timers"


def _stay_on(cpu: int | None) -> str:
    if sys.platform != "linux":
        raise _Denied("there is no such setting on this system")
    allowed = sorted(os.sched_getaffinity(0))
    if cpu is not None and cpu not in allowed:
        known = ", ".join(map(str, allowed))
        raise UsageError(f"processor {cpu} isn't one that this process may use; expected one of {known}")
    chosen = allowed[-1] if cpu is None else cpu
    try:
        os.sched_setaffinity(0, {chosen})
    except OSError as error:
        raise _Denied(_reason(error)) from None
    return f"processor {chosen}"


def _lock_memory() -> str:
    if sys.platform != "linux":
        raise _Denied("there is no such setting on this system")
    import resource

    # With a finite limit, later requests for memory beyond it would fail: the precaution itself would crash the run.
    limit = _raise_limit(resource.RLIMIT_MEMLOCK)
    if limit != resource.RLIM_INFINITY and not _capable(_CAP_IPC_LOCK):
        raise _Denied(f"no more than {limit // 1024} KiB may be locked")
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        raise _Denied(_last_error())
    return "memory locked"


def _go_first(priority: int) -> str:
    if sys.platform != "linux":
        raise _Denied("there is none on this system")
    import resource

    share = _real_time_share()
    if share < _SMALLEST_SHARE:
        raise _Denied(
            f"sched_rt_runtime_us leaves only {100 * share:.0f} % of a processor to real-time processes"
        )
    permitted = _raise_limit(resource.RLIMIT_RTPRIO)
    try:
        _set_fifo(priority)
    except PermissionError as error:
        if not 1 <= permitted < priority:
            raise _Denied(_reason(error)) from None
        priority = permitted
        try:
            _set_fifo(priority)
        except OSError as second:
            raise _Denied(_reason(second)) from None
    except OSError as error:
        raise _Denied(_reason(error)) from None
    return f"real-time priority {priority} (SCHED_FIFO)"


def _set_fifo(priority: int) -> None:
    """First in, first out; what this process starts is scheduled as usual again."""
    if sys.platform == "linux":
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def _raise_limit(limit: int) -> int:
    """Raise a limit of this process as far as it may itself, and return it."""
    import resource

    now, most = resource.getrlimit(limit)
    if now != most:
        resource.setrlimit(limit, (most, most))
    return most


def _real_time_share() -> float:
    """The share of each processor's time that the kernel leaves to real-time processes; 1 where it doesn't say."""
    folder = Path("/proc/sys/kernel")
    try:
        runtime, period = (
            int((folder / f"sched_rt_{name}_us").read_text()) for name in ("runtime", "period")
        )
    except (OSError, ValueError):  # a container may hide them
        return 1.0
    return 1.0 if runtime < 0 else runtime / period


def _capable(capability: int) -> bool:
    """Whether this process has a capability, independent of its user."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return os.geteuid() == 0
    effective = next((line.split()[1] for line in status.splitlines() if line.startswith("CapEff:")), "0")
    return bool(int(effective, 16) >> capability & 1)


def _last_error() -> str:
    return os.strerror(ctypes.get_errno()).lower()


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()

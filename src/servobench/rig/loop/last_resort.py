"""The system itself ends a loop's process that hangs: no other process may be left, and Python code may be blocked."""

from __future__ import annotations

import ctypes
import faulthandler
import signal
import sys
import time

from servobench.rig.devices.observed import Call
from servobench.rig.loop.ring import CALL, OPENING_TIME, ZERO_VOLTS, RowRing
from servobench.rig.loop.silence import OPENING_PATIENCE, RUN_PATIENCE

_MARGIN = 2.0  # s; who started the loop is first, as it can tell what happened
_PUT_OFF_EVERY = 500_000_000  # ns; it costs a call of the system each time
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_OPENING = (Call.OPEN, Call.START)
_RUNNING = (Call.READ, Call.WRITE)


class LastResort:
    """Ends this process where it isn't put off for too long: a dead man's switch.

    On POSIX a timer of the kernel's does it (SIGALRM, whose default action ends a process), on Windows a thread in C
    (`faulthandler`); neither needs the interpreter's lock. A device that uses SIGALRM itself takes it away.
    """

    def __init__(self) -> None:
        if sys.platform != "win32":
            signal.signal(signal.SIGALRM, signal.SIG_DFL)  # who started this process may have ignored it

    def put_off(self, patience: float) -> None:
        """Let it come no earlier than in `patience` seconds; 0: not at all."""
        if sys.platform != "win32":
            signal.setitimer(signal.ITIMER_REAL, patience)
        elif patience:
            faulthandler.dump_traceback_later(patience, exit=True)
        else:
            faulthandler.cancel_dump_traceback_later()

    def with_parent(self, wanted: bool) -> None:
        """Let this process end at once with the one that started it, or no longer; Linux only.

        It is for a device that is being opened, which may take long and puts out nothing: no hanging process is left behind.
        """
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGKILL if wanted else 0), 0, 0, 0)


class CallsInRing:
    """An observer that writes into the ring what the loop's thread is doing, and puts the last resort off while it goes on.

    `opening_time` is how long the device may take to be opened where nothing is wrong [s].
    """

    def __init__(
        self, rows: RowRing, sample_time: float, last_resort: LastResort, opening_time: float = 0.0
    ) -> None:
        self._rows = rows
        self._memory = rows.memory  # it stays while a call hangs, even if another thread closes the ring
        self._set = rows._kernels.set_word
        self._last_resort = last_resort
        self._patience = RUN_PATIENCE + 2 * sample_time + _MARGIN
        self._opening_patience = OPENING_PATIENCE + opening_time + _MARGIN
        self._due = 0
        self._set(self._memory, OPENING_TIME, round(1e9 * opening_time))

    def began(self, call: Call) -> None:
        """Note that a call has begun."""
        now = time.monotonic_ns()
        self._set(self._memory, CALL, now << 3 | call)
        if call in _RUNNING and now < self._due:
            return
        self._due = now + _PUT_OFF_EVERY
        if call in _OPENING:
            self._last_resort.with_parent(True)
            self._last_resort.put_off(self._opening_patience)
        else:
            self._last_resort.put_off(self._patience)

    def note_return(self, call: Call) -> None:
        """Note that it has returned; between the calls of a run the loop is expected to go on, otherwise it may take its time."""
        if call in _RUNNING:
            self._set(self._memory, CALL, time.monotonic_ns() << 3 | Call.BETWEEN)
            return
        self._set(self._memory, CALL, 0)
        self._last_resort.put_off(0.0)
        self._last_resort.with_parent(False)
        self._due = 0

    def output(self, is_zero: bool) -> None:
        """Note what is known of the output."""
        self._set(self._memory, ZERO_VOLTS, int(is_zero))

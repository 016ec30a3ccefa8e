"""Ctrl-C in a terminal reaches all its processes; only the one that the user started acts on it.

A child ignores it. Before a child gets that far, Python's default would be a traceback, so the signal waits: the
mask of blocked signals is inherited, and a signal that is ignored when it is let through is dropped (signal(7), POSIX.1-2017,
section 2.4.1). Windows has no such mask.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def hold_interrupts() -> Iterator[None]:
    """Let Ctrl-C wait, here and in any process that is started meanwhile; here it arrives at the end."""
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def ignore_interrupts() -> None:
    """Ignore Ctrl-C in this process from now on, one that waited included."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})

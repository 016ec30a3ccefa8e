"""The watchdog's thread: it checks from time to time whether the loop still drives."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Watcher:
    """A thread that calls `look` repeatedly, each time after the seconds that the last call returned, until it is ended.

    It runs while the loop's thread sleeps, waits for a device, or computes in Python. It can't run where an extension keeps the
    interpreter's lock, nor in a process that was stopped or killed: only the device's own watchdog helps then.
    """

    def __init__(self, look: Callable[[], float]) -> None:
        self._look = look
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="servobench watchdog", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Let it end, and wait for that unless it is stuck in the device."""
        self._ended.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(timeout=1.0)

    def _watch(self) -> None:
        while not self._ended.wait(self._look()):
            pass

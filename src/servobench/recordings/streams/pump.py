"""A thread that fetches bytes: a source has little room, and would overflow while its rows are processed."""

from __future__ import annotations

from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Event, Thread


class Pump:
    """Fetches by `fetch` without a pause until that returns None, which is the end; b"" says that nothing has come yet."""

    def __init__(self, fetch: Callable[[], bytes | None]) -> None:
        self._fetch = fetch
        self._blocks: SimpleQueue[bytes | None] = SimpleQueue()
        self._stopped = Event()
        self._ended = False
        # A daemon: a fetch that waits for a source that says nothing can't always be ended.
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def take(self, patience: float) -> bytes | None:
        """Return what has come, after waiting `patience` [s] at most for the first byte; None after the end."""
        if self._ended:
            return None
        data = b""
        try:
            block = self._blocks.get(timeout=patience)
            while block is not None:
                data += block
                block = self._blocks.get_nowait()
            self._ended = True
        except Empty:
            return data
        return data or None

    def stop(self, patience: float) -> None:
        """Fetch no more, and wait `patience` [s] at most for the fetch under way."""
        self._stopped.set()
        self._thread.join(patience)

    def _run(self) -> None:
        while not self._stopped.is_set() and (block := self._fetch()) is not None:
            if block:
                self._blocks.put(block)
        self._blocks.put(None)

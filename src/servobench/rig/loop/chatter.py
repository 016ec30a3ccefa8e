"""The output that a loop's process prints, for example from a device's driver: read at once, so that no full pipe blocks it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import IO

SHOWN = 10  # lines; a driver that warns at every read would fill the terminal
_LONGEST = 500  # characters of a line
_PATIENCE = 0.5  # s; for what a process that has ended printed last


class Chatter:
    """A thread that reads a process's output to its end, shows the first lines and remembers the last.

    `show` gets each of the first lines, without control characters. Call `end` once the process has ended.
    """

    def __init__(self, pipe: IO[bytes], show: Callable[[str], None]) -> None:
        self._pipe = pipe
        self._show = show
        self._last = ""
        self._lines = 0
        self._thread = threading.Thread(target=self._read, name="servobench chatter", daemon=True)
        self._thread.start()

    @property
    def last(self) -> str:
        """The last line that isn't empty; empty where there is none."""
        self._thread.join(_PATIENCE)
        return self._last

    def end(self) -> None:
        """Say how much wasn't shown, and close the pipe unless a process that outlives this one still holds it."""
        self._thread.join(_PATIENCE)
        if self._lines > SHOWN:
            self._show(f"… and {self._lines - SHOWN} more lines; the last one: {self._last}")
        if not self._thread.is_alive():
            self._pipe.close()

    def _read(self) -> None:
        # A line without an end comes in pieces, so that it needs no memory.
        while piece := self._pipe.readline(_LONGEST):
            line = _printable(piece.decode("utf-8", "backslashreplace").strip())
            if not line:
                continue
            self._last = line
            self._lines += 1
            if self._lines <= SHOWN:
                self._show(line)


def _printable(line: str) -> str:
    """The line with control characters, which could move the cursor or colour the terminal, as escapes."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in line)

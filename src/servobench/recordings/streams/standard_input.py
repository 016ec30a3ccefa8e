"""Standard input: lines from any program, such as `arduino-cli monitor ... | servobench watch -`."""

from __future__ import annotations

import os
import sys
from queue import Empty, SimpleQueue
from threading import Thread
from types import TracebackType
from typing import Self

from servobench.core.errors import UsageError
from servobench.recordings.streams.base import STREAMS, Rows
from servobench.recordings.streams.line_table import LineTable

_BLOCK = 1 << 16  # bytes


@STREAMS.member("standard_input")
class StandardInput:
    """Lines of standard input until its end. A thread reads them, as no system can wait for a pipe and a clock alike.

    Raises `UsageError` for anything behind the `-`.
    """

    name = "standard input"

    def __init__(self, rest: str = "") -> None:
        if rest:
            raise UsageError(f"standard input takes no {rest!r}: say - alone")
        self._table = LineTable()
        self._blocks: SimpleQueue[bytes] = SimpleQueue()
        self._ended = False

    def __enter__(self) -> Self:
        """Begin to read."""
        if sys.stdin is None or sys.stdin.isatty():
            raise UsageError(
                "nothing is piped into standard input; put a program before it: PROGRAM | servobench watch -"
            )
        # A daemon: a read that waits for a program that says nothing can't be ended.
        Thread(target=self._read, args=(sys.stdin.fileno(),), daemon=True).start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave standard input open: it belongs to the caller."""

    def read(self, patience: float) -> Rows | None:
        """Return the rows that have come; None after the end of the input."""
        if self._ended:
            return None
        data = b""
        try:
            block = self._blocks.get(timeout=patience)
            while block:
                data += block
                block = self._blocks.get_nowait()
            self._ended = True
        except Empty:
            return self._table.take(data)
        return self._table.take(data + b"\n")

    def _read(self, number: int) -> None:
        while block := os.read(number, _BLOCK):
            self._blocks.put(block)
        self._blocks.put(b"")

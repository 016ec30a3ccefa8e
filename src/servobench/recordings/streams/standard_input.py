"""Standard input: lines from any program, such as `arduino-cli monitor ... | servobench watch -`."""

from __future__ import annotations

import os
import sys
from types import TracebackType
from typing import Self

from servobench.core.errors import UsageError
from servobench.recordings.streams.base import STREAMS, Rows
from servobench.recordings.streams.line_table import LineTable
from servobench.recordings.streams.pump import Pump

_BLOCK = 1 << 16  # bytes


@STREAMS.member("standard_input")
class StandardInput:
    """Lines of standard input until its end. A `Pump` reads them, as no system can wait for a pipe and a clock alike.

    Raises `UsageError` for anything behind the `-`.
    """

    name = "standard input"

    def __init__(self, rest: str = "") -> None:
        if rest:
            raise UsageError(f"standard input takes no {rest!r}: write - alone")
        self._table = LineTable()
        self._pump: Pump | None = None
        self._ended = False

    def __enter__(self) -> Self:
        """Begin to read."""
        if sys.stdin is None or sys.stdin.isatty():
            raise UsageError(
                "nothing is piped into standard input; put a program before it: PROGRAM | servobench watch -"
            )
        number = sys.stdin.fileno()
        self._pump = Pump(lambda: os.read(number, _BLOCK) or None)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave standard input open: it belongs to the caller."""

    def read(self, patience: float) -> Rows | None:
        """Return the rows that have come; None after the end of the input; raises `UsageError` where it isn't open."""
        if self._pump is None:
            raise UsageError("standard input isn't open: use the stream in a `with`")
        if self._ended:
            return None
        data = self._pump.take(patience)
        self._ended = data is None
        return self._table.take(b"\n" if data is None else data)  # its last line may have no end

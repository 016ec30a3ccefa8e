"""The kind `streams`: rows of a motor that others drive, as they come. Nothing is ever sent to the motor.

A member is a class that `STREAMS.member(name)` decorates, made of the text behind `NAME:`. It is a context manager; what it holds
open begins and ends with it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.registry import Registry


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Rows that have come: `values` (N, C) of the columns with these `names`, in their own units.

    `damaged` lines among them weren't rows; `example` is the first of those, or before the first row the last line that was none.
    """

    names: tuple[str, ...]
    values: Array
    damaged: int = 0
    example: str = ""

    def blocks(self, count: int) -> Iterator[Rows]:
        """Yield the same in blocks of `count` rows at most, one of none where there are none; damaged lines go with the first."""
        for begin in range(0, max(len(self.values), 1), count):
            values = self.values[begin : begin + count]
            yield replace(self, values=values) if begin == 0 else Rows(names=self.names, values=values)


@runtime_checkable
class Stream(Protocol):
    """Rows as they come."""

    name: str
    """Its description for people."""

    def __enter__(self) -> Self:
        """Open it; raises `UsageError` or `DeviceError`, which say what to do, where that can't be done."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        ...

    def read(self, patience: float) -> Rows | None:
        """Return the rows that have come, after waiting `patience` [s] at most for the first; None where no more will come."""
        ...


STREAMS: Registry[type[Stream]] = Registry("stream", "servobench.recordings.streams", "servobench.streams")
_PORT = re.compile(r"(/dev/(?!shm/).+|COM\d+)(@\d+)?", re.IGNORECASE)


def stream_of(source: str) -> Stream:
    """Return the stream that a source names, not yet open: `-`, `NAME:REST`, a serial port, or else the path of a file.

    Raises `UsageError` for what no stream can be made of.

    >>> stream_of("udp:5005").name
    'UDP port 5005'
    """
    if source == "-":
        return _make("standard_input", "")
    if _PORT.fullmatch(source):
        return _make("serial", source)
    name, colon, rest = source.partition(":")
    if colon and name in STREAMS:
        return _make(name, rest)
    if not Path(source).exists():
        kinds = ", ".join(f"{each}:..." for each in STREAMS.names() if each != "standard_input")
        raise UsageError(
            f"{source!r} isn't a source of rows: expected -, a serial port, a file that exists, or one of {kinds}"
        )
    return _make("file", source)


def _make(name: str, rest: str) -> Stream:
    make: type = STREAMS[name]
    stream: Stream = make(rest)
    return stream

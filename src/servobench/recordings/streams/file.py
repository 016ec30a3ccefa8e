"""A text file that another program is still writing: what is in it, and what is added."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from servobench.core.errors import UsageError
from servobench.recordings.streams.base import STREAMS, Rows
from servobench.recordings.streams.line_table import LineTable

_BLOCK = 1 << 20  # bytes at once
_AGAIN = 0.05  # s between two looks at a file that hasn't grown


@STREAMS.member("file")
class GrowingFile:
    """The lines of a text file from its beginning, then those that are added; one that became shorter is read from its beginning.

    Nobody says that a file won't grow any more: it has no end.
    """

    def __init__(self, rest: str, *, sleep: Callable[[float], None] = time.sleep) -> None:
        self._path = Path(rest)
        self.name = str(self._path)
        self._table = LineTable()
        self._file: BinaryIO | None = None
        self._sleep = sleep

    def __enter__(self) -> Self:
        """Open the file."""
        try:
            self._file = self._path.open("rb")
        except OSError as error:
            raise UsageError(f"{self._path} can't be read: {error.strerror or error}") from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def read(self, patience: float) -> Rows | None:
        """Return the rows that were added; never None."""
        waited = 0.0
        while not (data := self._new_bytes()) and waited < patience:
            self._sleep(_AGAIN)
            waited += _AGAIN
        return self._table.take(data)

    def _new_bytes(self) -> bytes:
        if self._file is None:
            raise UsageError(f"{self._path} isn't open: use the stream in a `with`")
        if self._path.exists() and self._path.stat().st_size < self._file.tell():
            self._file.close()
            self._file = self._path.open("rb")
        return self._file.read(_BLOCK)

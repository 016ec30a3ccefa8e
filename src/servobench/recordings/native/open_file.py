"""A recording in a file that is complete: the file stays open, and is read when a sample is first looked at."""

from __future__ import annotations

import os
import sys
import weakref
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import Any

from servobench.core.channels import Array, Channel
from servobench.core.errors import StorageError
from servobench.core.finding import Finding
from servobench.recordings.native.reader import CUT_SHORT, read, read_open
from servobench.recordings.recording import Recording, Series, Stopped

MOST_OPEN = 64  # files; a process may have about a thousand, on some systems 256


def recording_in(path: Path, opening: Recording, stopped: Stopped, findings: Iterable[Finding]) -> Recording:
    """Return the one recording that was written to a native file, without reading it: what `read` would return.

    `opening`, `stopped` and `findings` are what the writer was given. The file can be moved, removed or replaced
    meanwhile, as it stays open until a sample is looked at; that raises `StorageError` where something else was
    written into it. With `MOST_OPEN` of them open, and on Windows, where nobody can move an open file, it is read
    at once; raises `FormatError` where it can't be.
    """
    if sys.platform == "win32" or len(_OPEN) >= MOST_OPEN:
        (recording,) = read(path)
        return recording
    content = _Content(path)
    series = tuple(SeriesInFile.of(each.channel, content) for each in opening.series)
    return replace(opening, series=series, stopped=stopped, findings=tuple(findings))


class SeriesInFile(Series):
    """A series that has no `values` and `t` until somebody asks for them. A copy of it is a plain one."""

    _content: _Content

    @classmethod
    def of(cls, channel: Channel, content: _Content) -> SeriesInFile:
        """Return the series of a channel in a file."""
        series = cls.__new__(cls)
        vars(series).update(channel=channel, _content=content)
        return series

    def __getattr__(self, name: str) -> Any:
        """Read the file for `values` and `t`, which are attributes from then on; there is nothing else to be found here."""
        if name not in ("values", "t"):
            raise AttributeError(f"a Series has no attribute {name!r}", name=name, obj=self)
        series = self._content.recording[self.channel.name]
        vars(self).update(values=series.values, t=series.t)
        return vars(self)[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return _series, (self.channel, self.values, self.t)


def _series(channel: Channel, values: Array, t: Array | None) -> Series:
    return Series(channel=channel, values=values, t=t)


class _Content:
    """The content of a file that is open, read once."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._number = os.open(path, os.O_RDONLY)
        self._close = weakref.finalize(self, os.close, self._number)
        self._stamp = _stamp(self._number)
        self._read: Recording | None = None
        self._alone = Lock()
        _OPEN.add(self)

    @property
    def recording(self) -> Recording:
        """The recording; raises `StorageError` where the file isn't what it was."""
        with self._alone:
            if self._read is None:
                self._read = self._read_all()
                self._close()
                _OPEN.discard(self)
            return self._read

    def _read_all(self) -> Recording:
        try:
            if _stamp(self._number) == self._stamp:
                with open(os.dup(self._number), "rb") as file:
                    file.seek(0)
                    (recording,) = read_open(self._path, file)
                if recording.stopped != CUT_SHORT:
                    return recording
                why = "the file is damaged"
            else:
                why = "something else was written into it after the run"
        except OSError as error:
            why = error.strerror or str(error)
        raise StorageError(f"{self._path}: the samples of this recording are lost: {why}; run it again")


_OPEN: weakref.WeakSet[_Content] = weakref.WeakSet()


def _stamp(number: int) -> tuple[int, int]:
    """The state of a file that every write changes: its size [bytes] and the time of the last change [ns]."""
    state = os.fstat(number)
    return state.st_size, state.st_mtime_ns

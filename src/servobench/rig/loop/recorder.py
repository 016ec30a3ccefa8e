"""Recorders of a run's rows: in memory, or to a file without delaying the loop."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from queue import Full, Queue
from threading import Thread
from typing import Protocol

from servobench.core.channels import Array
from servobench.core.errors import StorageError
from servobench.core.finding import Finding
from servobench.recordings.native.open_file import recording_in
from servobench.recordings.native.writer import RecordingWriter, Together
from servobench.recordings.recording import Recording, Series, Stopped
from servobench.recordings.row_store import RowStore


class Recorder(Protocol):
    """Takes the rows of one run, and gives the recording in the end."""

    def append(self, rows: Array) -> None:
        """Take rows (N, 1 + C): the time [s] and a value of each channel; raises `StorageError`."""
        ...

    def end(self, stopped: Stopped, findings: tuple[Finding, ...]) -> Recording:
        """Return the recording, complete; raises `StorageError` where it can't be completed."""
        ...

    def abandon(self) -> None:
        """Let go of everything; what is in a file stays there. Never raises."""
        ...

    def discard(self) -> None:
        """Let go of everything, and remove the file: there was no run. Never raises."""
        ...


class InMemory:
    """Keeps the rows in memory, `expected` many. `opening` is what is known of the recording, with empty series."""

    def __init__(self, opening: Recording, expected: int = 0) -> None:
        self._opening = opening
        self._rows = RowStore(1 + len(opening.series), expected)

    def append(self, rows: Array) -> None:
        """Keep rows (N, 1 + C): the time [s] and a value of each channel."""
        self._rows.append(rows)

    def end(self, stopped: Stopped, findings: tuple[Finding, ...]) -> Recording:
        """Return the rows so far as a recording."""
        t, *columns = self._rows.columns
        series = tuple(
            Series(channel=each.channel, values=values, t=t)
            for each, values in zip(self._opening.series, columns, strict=True)
        )
        return replace(self._opening, series=series, stopped=stopped, findings=findings)

    def abandon(self) -> None:
        """Forget the rows."""
        self._rows = RowStore(1 + len(self._opening.series))

    def discard(self) -> None:
        """Forget the rows."""
        self.abandon()


class ToFile:
    """Streams the rows to a native file, by a thread of its own: the loop doesn't wait for the disk.

    `patience` is how long `append` waits where the disk is many blocks behind [s]; then it raises `StorageError`. It is 0 where a
    motor turns meanwhile. Raises what `RecordingWriter` raises where the file can't be begun.
    """

    BLOCKS_BEHIND = 64

    def __init__(self, opening: Recording, path: str | os.PathLike[str], *, patience: float) -> None:
        self._path = Path(path)
        self._opening = opening
        self._patience = patience
        self._writer = RecordingWriter(path)
        self._writer.begin(opening, [Together(channels=tuple(each.channel.name for each in opening.series))])
        self._blocks: Queue[Array | None] = Queue(self.BLOCKS_BEHIND)
        self._failure: BaseException | None = None
        # A daemon, so that a disk that hangs doesn't keep the program from ending.
        self._thread = Thread(target=self._write, name="servobench recorder", daemon=True)
        self._thread.start()

    def append(self, rows: Array) -> None:
        """Hand rows (N, 1 + C), as in `InMemory`, to the writing thread; raises what went wrong there with earlier ones."""
        self._check()
        try:
            self._blocks.put(rows, timeout=self._patience)
        except Full:
            raise StorageError(
                f"{self._path}: the disk doesn't keep up with the run: {self.BLOCKS_BEHIND} blocks are waiting to be "
                f"written; everything written so far is kept in ({self._path.name}.part)"
            ) from None

    def end(self, stopped: Stopped, findings: tuple[Finding, ...]) -> Recording:
        """Wait for the last row to be written, and finish the file; it is read when a sample is looked at."""
        self._blocks.put(None)
        self._thread.join()
        try:
            self._check()
            self._writer.end(stopped, findings)
            self._writer.close()
        finally:
            self._writer.abandon()
        return recording_in(self._path, self._opening, stopped, findings)

    def abandon(self) -> None:
        """Leave the part of the file that there is, as far as it's written."""
        with suppress(Full):
            self._blocks.put(None, timeout=1.0)
            self._thread.join(timeout=1.0)
        if not self._thread.is_alive():  # closing would wait for a disk that hangs, as the thread does
            self._writer.abandon()

    def discard(self) -> None:
        """Close the part of the file, and remove it."""
        self.abandon()
        with suppress(OSError):
            self._path.with_name(f"{self._path.name}.part").unlink()

    def _check(self) -> None:
        if self._failure is not None:
            raise self._failure

    def _write(self) -> None:
        """Write block after block; after a failure, discard them, so that the loop doesn't wait."""
        while (rows := self._blocks.get()) is not None:
            if self._failure is None:
                try:
                    self._writer.append(0, rows)
                except BaseException as error:
                    self._failure = error

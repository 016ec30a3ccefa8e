"""A growing MCAP file: complete up to the last chunk at any moment, with a summary once it is closed."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
import time
import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import chain, count
from pathlib import Path
from typing import BinaryIO

from servobench.core.errors import StorageError, UsageError
from servobench.recordings.native import mcap
from servobench.recordings.native.lease import hold, is_held

PART = ".part"
MOST_NUMBERS = 65535  # schemas and channels are numbered in two bytes, from 1
SYNC_INTERVAL = 1.0  # s; what a power cut may cost


class McapFile:
    """Writes MCAP records to `path` with `.part` behind its name; closing it gives the file its own name.

    The part is locked (lease.py) as long as it is open. Each record belongs to the system once its call returns, and so outlives
    this process. About once a second, by the clock `now` [s], the file is put on the disk itself, and so outlives a power cut.
    Where somebody has removed or renamed the part by then, all that it held is copied to a place that is still there
    (`place_beside`), and the file goes on there; `close` raises `StorageError`, which says where it is.

    Raises `UsageError` where there is a part already, and `StorageError`, with the part kept, where nothing more can be written.
    Nothing is closed then: a disk that fails may let closing wait, and somebody may have a motor to stop first. `abandon` closes.
    """

    def __init__(
        self, path: str | os.PathLike[str], *, library: str, now: Callable[[], float] = time.monotonic
    ) -> None:
        self.path = self._asked = Path(path)
        self.part = _part_of(self.path)
        self._absolute = self.path.absolute()  # as long as there surely is a current folder
        self._now = now
        self._synced = now()
        self._size = 0
        self._crc = 0
        self._schemas: dict[str, tuple[int, bytes]] = {}
        self._channels: dict[int, bytes] = {}
        self._counts: dict[int, int] = {}
        self._metadata: list[bytes] = []
        self._chunks = bytearray()  # index records; a list of them would take several times the memory
        self._chunk_count = 0
        self._span: tuple[int, int] | None = None
        self._compressor = mcap.compressor()
        self._failure = ""
        self._file = _new_file(self.part)
        hold(self._file)  # without locks, other processes can't see that the file is being written
        try:
            self._put(mcap.MAGIC + mcap.header(library))
        except StorageError:
            self.abandon()
            raise

    @property
    def channels(self) -> int:
        """The number of channels so far; the next one has the next number."""
        return len(self._channels)

    def add_metadata(self, name: str, entries: Mapping[str, bytes]) -> None:
        """Write a metadata record; raises `UsageError` where it would be too long to be read again."""
        record = mcap.metadata(name, entries)
        if len(record) > mcap.LARGEST_RECORD:
            raise UsageError(
                f"{self.path}: the description of a recording takes {len(record)} bytes, more than "
                f"{mcap.LARGEST_RECORD}; shorten its experiment or its list of channels"
            )
        self._metadata.append(mcap.metadata_index(self._size, len(record), name))
        self._put(record)

    def add_channel(self, topic: str, definition: str) -> int:
        """Write a channel with messages of that definition, and return its number; raises `UsageError` past the last one."""
        number = len(self._channels) + 1
        if number > MOST_NUMBERS:
            raise UsageError(
                f"{self.path}: an MCAP file has at most {MOST_NUMBERS} channels; write several files"
            )
        self._channels[number] = mcap.channel(number, self._schema(definition), topic)
        self._counts[number] = 0
        self._put(self._channels[number])
        return number

    def count(self, number: int) -> int:
        """Return the number of messages of a channel so far."""
        return self._counts[number]

    def add_messages(self, messages: mcap.Messages) -> None:
        """Write messages, at least one and all of one channel, as one chunk."""
        chunk = mcap.chunk(messages, self._compressor)
        index = chunk.index(self._size)
        self._put(chunk.record, chunk.message_index)
        self._chunks += index
        self._chunk_count += 1
        self._counts[chunk.number] += len(messages)
        start, end = self._span or (chunk.start, chunk.end)
        self._span = (min(start, chunk.start), max(end, chunk.end))

    def close(self) -> None:
        """Write the summary, put everything on the disk and give the file its name, in place of an earlier file of that name.

        Does nothing to a file that is closed already. Raises `StorageError` where it can't be done, or not under that name.
        """
        if self._file.closed and not self._failure:
            return
        self._put(mcap.data_end(self._crc))
        self._put(self._summary())
        try:
            self._stay_reachable()
            os.fsync(self._file.fileno())
            self._file.close()
            os.replace(self.part, self.path)
        except OSError as error:
            raise self._storage_error(error) from error
        if self.path != self._asked:
            raise StorageError(elsewhere_text(self._asked, self.path))

    def abandon(self) -> None:
        """Close the part as it is: what it holds can be read. Never raises; does nothing after `close`."""
        with suppress(OSError):  # what the buffer still holds couldn't be written before, either
            self._file.close()

    def _schema(self, definition: str) -> int:
        """The number of the schema with that definition, which is written where it's new."""
        if definition not in self._schemas:
            number = len(self._schemas) + 1
            # A name of its own for each definition: viewers look definitions up by name.
            record = mcap.schema(number, f"servobench/msg/Samples{number}", definition)
            self._put(record)
            self._schemas[definition] = (number, record)
        return self._schemas[definition][0]

    def _summary(self) -> bytes:
        start, end = self._span or (0, 0)
        statistics = mcap.statistics(
            counts=self._counts,
            schemas=len(self._schemas),
            metadata=len(self._metadata),
            chunks=self._chunk_count,
            start=start,
            end=end,
        )
        schemas = [record for _, record in self._schemas.values()]
        records = [*schemas, *self._channels.values(), statistics, bytes(self._chunks), *self._metadata]
        return mcap.summary(self._size, records)

    def _put(self, *records: bytes) -> None:
        if self._failure:
            raise StorageError(self._failure)
        if self._file.closed:
            raise UsageError(f"{self.path} is closed: nothing more can be written to it")
        try:
            for record in records:
                self._file.write(record)
            self._file.flush()
            now = self._now()
            if now - self._synced >= SYNC_INTERVAL:
                self._stay_reachable()
                os.fsync(self._file.fileno())
                self._synced = now
        except OSError as error:
            raise self._storage_error(error) from error
        for record in records:
            self._crc = zlib.crc32(record, self._crc)
            self._size += len(record)

    def _stay_reachable(self) -> None:
        """Go on elsewhere where the part's name no longer leads to it: what has no name is gone with this process."""
        with suppress(FileNotFoundError):
            if os.path.samestat(os.stat(self.part), os.fstat(self._file.fileno())):
                return
        path = place_beside(self._absolute)
        part = path.with_name(path.name + PART)
        file = open(part, "x+b")  # noqa: SIM115 - closed as the one before
        hold(file)
        self._file.seek(0)
        shutil.copyfileobj(self._file, file)
        file.flush()
        self._file.close()
        self._file, self.part = file, part
        self.path = self._asked if path == self._absolute else path

    def _storage_error(self, error: OSError) -> StorageError:
        self._failure = (
            f"{self.path} can't be written any further: {error.strerror or error}; "
            f"what was written before is kept in {self.part} (servobench recover makes a whole file of it)"
        )
        return StorageError(self._failure)


def _part_of(path: Path) -> Path:
    """The file that is written until `path` is whole; raises `UsageError` where `path` can't become a file."""
    if "\0" in str(path):
        raise UsageError(f"{str(path)!r} contains a zero byte; give the name of a file")
    if path.is_dir():
        raise UsageError(f"{path} is a folder; give the name of a file")
    if not path.parent.is_dir():
        raise UsageError(f"{path} can't be written: there is no folder {path.parent}; make it first")
    return path.with_name(path.name + PART)


def busy_text(part: Path) -> str:
    """Return the sentence that a part belongs to a run that goes on, and what to do."""
    return (
        f"{part} is being written by a running experiment: wait until it ends, stop it with Ctrl-C, or give "
        "another name"
    )


def place_beside(path: Path) -> Path:
    """Return where a file goes whose absolute `path` was taken away: as near to it as there is a folder to write in.

    That is `path` itself where only the file is missing; a folder above is told by the name, FOLDER-NAME.
    """
    *above, _ = path.parents  # the root of the file system is no place
    for folder in (*above, Path(tempfile.gettempdir())):
        if os.access(folder, os.W_OK):
            stem = path.stem if folder == path.parent else f"{path.parent.name}-{path.stem}"
            names = chain([stem], (f"{stem}-{number}" for number in count(2)))
            free = (folder / f"{name}{path.suffix}" for name in names)
            return next(each for each in free if not (each.exists() or Path(f"{each}{PART}").exists()))
    raise FileNotFoundError(errno.ENOENT, "there is no folder to write in", str(path.parent))


def elsewhere_text(requested: Path, path: Path) -> str:
    """Return the sentence that a recording isn't where it was to be, and what to do."""
    return (
        f"{requested} was removed or renamed while it was written; the recording is in {path} (servobench identify "
        f"{path})"
    )


def _new_file(part: Path) -> BinaryIO:
    """A part that wasn't there before, which can be read as well: it may have to be copied."""
    try:
        return open(part, "x+b")
    except FileExistsError:
        if is_held(part):
            raise UsageError(busy_text(part)) from None
        raise UsageError(
            f"{part} exists already: it is the unfinished recording of an earlier run. Recover it (servobench "
            "recover), or remove it"
        ) from None
    except OSError as error:
        raise StorageError(f"{part} can't be written: {error.strerror or error}") from error

"""Reads the native file: a complete one, or the intact part of a torn one."""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import warning
from servobench.recordings.native import mcap
from servobench.recordings.native.description import (
    ENDING,
    HAPPENING,
    OPENING,
    Ending,
    Group,
    Opening,
    RecordedEvent,
    parse_description,
)
from servobench.recordings.native.mcap import Damaged, Op
from servobench.recordings.recording import Event, Recording, Series, Stopped
from servobench.recordings.row_store import RowStore

_SPARE = 1.1  # rows for which there is room, over those that come if all chunks are as the first one
CUT_SHORT = Stopped(reason="unknown", sentence="the file ends before the reason why the recording ended")


def read(path: str | os.PathLike[str]) -> tuple[Recording, ...]:
    """Return the recordings in a native file.

    Of a file that was torn, or is damaged, this is all that comes before the first thing that isn't right, as each chunk and each
    description has its checksum; the last recording then has the finding `recording-cut-short`.
    Raises `FormatError` where the file can't be read, isn't a native one, or has nothing that is right.
    """
    path = Path(path)
    if "\0" in str(path):
        raise FormatError(f"{str(path)!r} can't be read: its name contains a zero byte")
    try:
        with open(path, "rb") as file:
            return read_open(path, file)
    except OSError as error:
        raise FormatError(f"{path} can't be read: {error.strerror or error}") from error


def read_open(path: Path, file: BinaryIO) -> tuple[Recording, ...]:
    """Return the same of a file that is open at its beginning; messages call it `path`. Raises `FormatError` and `OSError`."""
    size = os.fstat(file.fileno()).st_size
    _check_kind(path, file, size)
    scan = _collect(file, size)
    if not scan.recordings:
        raise FormatError(
            f"{path} is an unfinished or damaged recording, and nothing in it can be read: "
            f"{scan.damage or 'it holds no recording'}"
        )
    recordings = [each.recording() for each in scan.recordings]
    if scan.damage:
        recordings[-1] = _cut_short(recordings[-1], scan.damage, size - scan.right)
    elif scan.recordings[-1].ending is None:
        recordings[-1] = _cut_short(recordings[-1], "the recording was never ended", 0)
    return tuple(recordings)


@dataclass
class _PartialRecording:
    """A recording while it is read: what it says of itself, and the rows of each group and the events so far."""

    opening: Opening
    ending: Ending | None = None
    events: list[Event] = field(default_factory=list)
    groups: dict[int, Group] = field(init=False)
    rows: dict[int, RowStore] = field(init=False)

    def __post_init__(self) -> None:
        self.groups = {group.number: group for group in self.opening.groups}
        self.rows = {number: RowStore(group.columns) for number, group in self.groups.items()}
        names = [channel.name for channel in self.opening.channels]
        grouped = [name for group in self.opening.groups for name in group.channels]
        if len(self.groups) != len(self.opening.groups) or sorted(names) != sorted(grouped):
            raise Damaged("a description doesn't say where each channel is stored")

    def add(self, data: bytes, length: int, size: int) -> None:
        """Take the messages of a chunk of that length, in a file of that size [bytes]: all of it may be such chunks."""
        number = mcap.channel_of(data)
        if number not in self.groups or self.ending is not None:
            raise Damaged("a chunk belongs to no recording")
        columns, store = self.groups[number].columns, self.rows[number]
        rows = mcap.read_messages(data, number, len(store), columns)
        if not store:
            bytes_a_row = length / len(rows) + mcap.INDEX_ENTRY
            self.rows[number] = store = RowStore(columns, round(_SPARE * size / bytes_a_row))
        store.append(rows)

    def happen(self, happening: RecordedEvent) -> None:
        """Take an event, if it is the next one."""
        if self.ending is not None or happening.number != len(self.events):
            raise Damaged("an event is missing")
        self.events.append(happening.event)

    def end(self, ending: Ending) -> None:
        """Take what is said at the end, if it fits what came before."""
        if self.ending is not None or ending.rows != tuple(map(len, self.rows.values())):
            raise Damaged("samples are missing at the end")
        if ending.events != len(self.events):
            raise Damaged("events are missing at the end")
        self.ending = ending

    def recording(self) -> Recording:
        """Return the recording as far as it came."""
        opening, ending = self.opening, self.ending
        series = {name: each for group in opening.groups for name, each in self._series(group).items()}
        return Recording(
            name=opening.name,
            series=tuple(series[channel.name] for channel in opening.channels),
            source=opening.source,
            input=opening.roles.input,
            output=opening.roles.output,
            input_before=opening.roles.input_before,
            chain=opening.roles.chain,
            reference=opening.roles.reference,
            info=opening.info,
            experiment=opening.experiment,
            findings=ending.findings if ending else opening.findings,
            stopped=ending.stopped if ending else CUT_SHORT,
            versions=dict(opening.versions),
            events=tuple(self.events),
        )

    def _series(self, group: Group) -> dict[str, Series]:
        """The series of a group; they share one array of times."""
        columns = list(self.rows[group.number].columns)
        times = columns.pop(0) if group.timed else None
        channels = {channel.name: channel for channel in self.opening.channels}
        return {
            name: Series(channel=channels[name], values=values, t=times)
            for name, values in zip(group.channels, columns, strict=True)
        }


@dataclass
class _Scan:
    """The recordings so far, the number of intact bytes, and the damage after them, if any."""

    recordings: list[_PartialRecording] = field(default_factory=list)
    right: int = 0
    damage: str = ""


def _collect(file: BinaryIO, size: int) -> _Scan:
    """Take what is right, up to the end of the data or the first thing that isn't."""
    scan, decompressor = _Scan(), mcap.decompressor()
    try:
        for op, body, end in _records(file, size):
            if op == Op.METADATA:
                _take(scan.recordings, *mcap.read_metadata(body))
            elif op == Op.CHUNK:
                if not scan.recordings:
                    raise Damaged("a chunk comes before any recording")
                scan.recordings[-1].add(mcap.read_chunk(body, decompressor), len(body), size)
            scan.right = end
            if op == Op.DATA_END:
                return scan
        scan.damage = "it has no end"
    except Damaged as error:
        scan.damage = str(error)
    return scan


def _take(recordings: list[_PartialRecording], name: str, entries: dict[str, bytes]) -> None:
    """Process a metadata record: our own begin a recording, report an event or end it; all others are ignored."""
    if name == OPENING:
        if recordings and recordings[-1].ending is None:
            raise Damaged("a recording begins before the previous one has ended")
        unfinished = _PartialRecording(parse_description(Opening, entries))
        try:
            unfinished.recording()
        except UsageError as error:
            raise Damaged("a description contradicts itself") from error
        recordings.append(unfinished)
    elif name in (HAPPENING, ENDING):
        if not recordings:
            raise Damaged("a recording continues that never began")
        if name == HAPPENING:
            recordings[-1].happen(parse_description(RecordedEvent, entries))
        else:
            recordings[-1].end(parse_description(Ending, entries))


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes, int]]:
    """Yield opcode, body and end of each record; the body is empty for those whose content isn't needed.

    Ends where the file does; raises `Damaged` at a record that would run past it.
    """
    end = file.tell()
    while end < size:
        head = file.read(mcap.RECORD_HEAD)
        if len(head) < mcap.RECORD_HEAD:
            raise Damaged("it ends in the middle of a record")
        op, length = struct.unpack("<BQ", head)
        if length > size - end - mcap.RECORD_HEAD:
            raise Damaged("it ends in the middle of a record")
        end += mcap.RECORD_HEAD + length
        if op in (Op.METADATA, Op.CHUNK):
            if length > mcap.LARGEST_RECORD:
                raise Damaged("a record is larger than any that servobench writes")
            body = file.read(length)
        else:
            body = b""
            file.seek(end)
        yield op, body, end


def _check_kind(path: Path, file: BinaryIO, size: int) -> None:
    """Read up to the first record after the header; raises `FormatError` where it says that the file isn't ours."""
    if file.read(len(mcap.MAGIC)) != mcap.MAGIC:
        raise FormatError(f"{path} isn't an MCAP file: its first bytes differ")
    head = file.read(mcap.RECORD_HEAD)
    op, length = struct.unpack("<BQ", head) if len(head) == mcap.RECORD_HEAD else (0, 0)
    if op != Op.HEADER or length > min(size - file.tell(), mcap.LARGEST_RECORD):
        raise FormatError(
            f"{path} is an MCAP file that breaks off at its very beginning: nothing in it can be read"
        )
    try:
        library = mcap.read_header(file.read(length))
    except Damaged as error:
        raise FormatError(f"{path} is an MCAP file with a damaged header: {error}") from error
    if not library.startswith("servobench ") and not _opens_as_ours(file):
        raise FormatError(
            f"{path} is an MCAP file written by {library or 'an unknown program'!r}, not by servobench; servobench "
            "inspect and identify can read it, but only servobench's own files can be recovered"
        )


def is_foreign_mcap(head: bytes) -> bool:
    """Return whether a file that begins like this is an MCAP file of another program, as its header says."""
    file = io.BytesIO(head)
    if file.read(len(mcap.MAGIC)) != mcap.MAGIC or len(head) < len(mcap.MAGIC) + mcap.RECORD_HEAD:
        return False
    op, length = struct.unpack("<BQ", file.read(mcap.RECORD_HEAD))
    if op != Op.HEADER or length > len(head):
        return False
    try:
        library = mcap.read_header(file.read(length))
    except Damaged:
        return False
    return not library.startswith("servobench ") and not _opens_as_ours(file)


def _opens_as_ours(file: BinaryIO) -> bool:
    """Return whether the next record begins a recording of ours, whatever the damaged header before it says."""
    opening = mcap.prefix_length(OPENING)
    start = file.tell()
    head = file.read(mcap.RECORD_HEAD + len(opening))
    file.seek(start)
    return head[:1] == bytes([Op.METADATA]) and head[mcap.RECORD_HEAD :] == opening


def _cut_short(recording: Recording, damage: str, dropped: int) -> Recording:
    """The recording with a finding that says what is missing."""
    left_out = f"; the last {dropped} bytes of the file were left out" if dropped else ""
    sentence = (
        f"the recording was cut short, as its file doesn't end properly ({damage}); everything before that is "
        f"intact{left_out}"
    )
    return recording.with_findings(warning("recording-cut-short", sentence))

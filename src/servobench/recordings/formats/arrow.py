"""Apache Arrow's own files (IPC), which Feather files of version 2 are too: the file format and the stream.

A file is read as the stream that it holds between its marks, so that one which was cut short gives the batches before the cut.
Source: Apache Arrow, "Arrow Columnar Format: Serialization and Interprocess Communication".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, final

from servobench.core.errors import FormatError
from servobench.core.finding import info
from servobench.recordings.formats import arrow_table
from servobench.recordings.formats.arrow_messages import next_message, uncompressed_size
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.unpacking import most_bytes
from servobench.recordings.recording import Recording

_MAGIC = b"ARROW1"
_FEATHER_1 = b"FEA1"
_CONTINUATION = b"\xff\xff\xff\xff"
_LONGEST_SCHEMA = 2**24  # bytes


@final
@FORMATS.member("arrow")
@dataclass(frozen=True, kw_only=True)
class Arrow:
    """Arrow files and streams. Columns, units and time stamps are those of a Parquet file."""

    suffixes: ClassVar[tuple[str, ...]] = (".arrow", ".feather", ".ipc", ".arrows")

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like an Arrow file, or like a stream with its schema."""
        if head.startswith((_MAGIC, _FEATHER_1)):
            return True
        return head.startswith(_CONTINUATION) and 0 < int.from_bytes(head[4:8], "little") <= _LONGEST_SCHEMA

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the one recording in a file, of as many batches as it has; raises `FormatError` where it can't be read.

        Raises `UsageError` where pyarrow isn't installed.
        """
        pa = arrow_table.pyarrow("pyarrow", path.name)
        data = path.read_bytes()
        if data.startswith(_FEATHER_1):
            raise FormatError(
                f"{path.name} is a Feather file of version 1, which isn't read; write it again as version 2 or as Parquet"
            )
        stream, whole = _stream(data)
        with arrow_table.told_as_format_error(path.name, "Arrow"):
            end = _checked_end(stream, most_bytes(path))
            whole = whole and end == len(stream)
            options = pa.ipc.IpcReadOptions(use_threads=False)
            reader = pa.ipc.open_stream(pa.py_buffer(stream[:end]), options=options)
            batches = list(reader)
        recording = arrow_table.recording_in(batches, reader.schema, path, "arrow")
        if not whole:
            sentence = "The file ends before its last batch does; the batches before that are read."
            recording = recording.with_findings(info("recording-cut-short", sentence))
        return (recording,)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write a recording with all its digits and all that it knows; raises `UsageError` for more than one."""
        pa = arrow_table.pyarrow("pyarrow", path.name)
        table = arrow_table.table_of(recordings, path.name)
        with path.open("wb") as file, pa.ipc.new_file(file, table.schema) as writer:
            writer.write_table(table)


def _stream(data: bytes) -> tuple[bytes, bool]:
    """The stream in a file, and whether the file has both its ends."""
    if not data.startswith(_MAGIC):
        return data, True
    if not data.endswith(_MAGIC) or len(data) < 22:
        return data[8:], False
    (footer,) = struct.unpack("<i", data[-10:-6])
    end = len(data) - 10 - footer
    return (data[8:end], True) if footer > 0 and end >= 8 else (data[8:], False)


def _checked_end(stream: bytes, most: int) -> int:
    """The end of the last message that is whole; raises `ValueError` where the messages claim more than is read."""
    total = at = 0
    while at < len(stream) and (message := next_message(stream, at)) is not None:
        if not message.metadata:  # the end of the stream; what comes after it doesn't belong to it
            return len(stream)
        total += uncompressed_size(message, stream)
        if total > most:
            raise ValueError(
                f"its batches come to more than {most} bytes; if it is sound, write it without compression"
            )
        at = message.end
    return at

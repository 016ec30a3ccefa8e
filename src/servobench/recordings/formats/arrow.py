"""Apache Arrow's own files (IPC), which Feather files of version 2 are too: the file format and the stream.

A file is read as the stream between its marks, so a truncated file gives the batches before the cut.
Source: Apache Arrow, "Arrow Columnar Format: Serialization and Interprocess Communication".
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, final

from servobench.core.errors import FormatError
from servobench.core.finding import info
from servobench.recordings.formats import arrow_table
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.extras import format_errors
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
    written: ClassVar[tuple[str, ...]] = suffixes
    by_library: ClassVar[bool] = True

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
                f"{path.name} is a Feather file of version 1, which isn't supported; save it as version 2 or as Parquet"
            )
        with format_errors(path.name, "Arrow"):
            stream = pa.py_buffer(data[8:] if data.startswith(_MAGIC) else data)
            reader = pa.ipc.open_stream(stream, options=pa.ipc.IpcReadOptions(use_threads=False))
            batches, damage = _batches(reader)
        recording = arrow_table.recording_in(batches, reader.schema, path, "arrow")
        if not damage and data.startswith(_MAGIC) and not data.endswith(_MAGIC):
            damage = "its end is missing"
        if damage:
            sentence = f"The file is cut short or damaged ({damage}); the batches before that are read."
            recording = recording.with_findings(info("recording-cut-short", sentence))
        return (recording,)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write a recording with all its digits and all that it knows; raises `UsageError` for more than one."""
        pa = arrow_table.pyarrow("pyarrow", path.name)
        table = arrow_table.table_of(recordings, path.name)
        with path.open("wb") as file, pa.ipc.new_file(file, table.schema) as writer:
            writer.write_table(table)


def _batches(reader: Any) -> tuple[list[Any], str]:
    """The batches of a stream up to the first that can't be read, and why it can't; raises that where there are none."""
    batches: list[Any] = []
    try:
        batches.extend(reader)
    except Exception as error:  # pyarrow tells of damage by errors of a dozen types
        if not batches:
            raise
        return batches, " ".join(str(error).split())[:80]
    return batches, ""

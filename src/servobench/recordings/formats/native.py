"""MCAP: the native file, as a run writes it, and those of others."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import ClassVar

from servobench.recordings.formats.base import FORMATS
from servobench.recordings.recording import Recording

_MAGIC = b"\x89MCAP"
_LONGEST_HEADER = 1 << 16  # bytes


@FORMATS.member("mcap")
class Native:
    """The one format that holds all of a recording: what it gives back equals what it was given, to the bit.

    Any MCAP reader shows its samples. A part that a run left behind (`.mcap.part`) is read as far as it is right. Of files that
    others wrote, ROS 2's and Foxglove's, the numbers in their messages are read (the extra `ros2`).
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mcap", ".part")

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether the file is an MCAP file, by its first bytes."""
        return head.startswith(_MAGIC)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recordings; the last one has the finding `recording-cut-short` where the file was torn.

        Raises `FormatError` where nothing in it can be read.
        """
        if _is_of_others(path):
            from servobench.recordings.formats.mcap_foreign import read as read_foreign

            return read_foreign(path)
        from servobench.recordings.native.reader import read

        return read(path)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write recordings; raises `UsageError` for none, `StorageError` where they can't be written."""
        from servobench.recordings.native.writer import save

        save(recordings, path)


def _is_of_others(path: Path) -> bool:
    """Whether the header names another program than this one as the one that wrote the file."""
    from servobench.recordings.native import mcap
    from servobench.recordings.native.reader import opens_as_ours

    with path.open("rb") as file:
        head = file.read(len(mcap.MAGIC) + mcap.RECORD_HEAD)
        if len(head) < len(mcap.MAGIC) + mcap.RECORD_HEAD or not head.startswith(mcap.MAGIC):
            return False
        op, length = struct.unpack_from("<BQ", head, len(mcap.MAGIC))
        if op != mcap.Op.HEADER or length > _LONGEST_HEADER:
            return False
        try:
            library = mcap.read_header(file.read(length))
        except mcap.Damaged:
            return False
        return not library.startswith("servobench ") and not opens_as_ours(file)

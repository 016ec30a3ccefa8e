"""The native file: MCAP, as a run writes it."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from servobench.formats.base import FORMATS
from servobench.recording.recording import Recording

_MAGIC = b"\x89MCAP"


@FORMATS.member("mcap")
class Native:
    """The one format that holds all of a recording: what it gives back equals what it was given, to the bit.

    Any MCAP reader shows its samples. A part that a run left behind (`.mcap.part`) is read as far as it is right.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mcap", ".part")

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether the file is an MCAP file, by its first bytes; reading one that isn't ours says so."""
        return head.startswith(_MAGIC)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recordings; the last one has the finding `recording-cut-short` where the file was torn.

        Raises `FormatError` where it isn't a native file, or where nothing in it can be read.
        """
        from servobench.recording.reader import read

        return read(path)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write recordings; raises `UsageError` for none, `StorageError` where they can't be written."""
        from servobench.recording.writer import save

        save(recordings, path)

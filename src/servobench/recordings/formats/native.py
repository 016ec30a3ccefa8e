"""MCAP: the native file, as a run writes it."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from servobench.recordings.formats.base import FORMATS
from servobench.recordings.native.mcap import MAGIC
from servobench.recordings.native.reader import is_foreign_mcap
from servobench.recordings.recording import Recording


@FORMATS.member("mcap")
class Native:
    """The one format that holds all of a recording: what it gives back equals what it was given, to the bit.

    Any MCAP reader shows its samples. A part that a run left behind (`.mcap.part`) is read as far as it is right.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".mcap", ".part")
    written: ClassVar[tuple[str, ...]] = (".mcap",)
    by_library: ClassVar[bool] = False

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether the file is an MCAP file, by its first bytes, and not one of another program."""
        return head.startswith(MAGIC[:5]) and not is_foreign_mcap(head)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recordings; the last one has the finding `recording-cut-short` where the file was torn.

        Raises `FormatError` where nothing in it can be read.
        """
        from servobench.recordings.native.reader import read

        return read(path)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write recordings; raises `UsageError` for none, `StorageError` where they can't be written."""
        from servobench.recordings.native.writer import save

        save(recordings, path)

"""Recovers a torn recording: what is right in it, as a whole file."""

from __future__ import annotations

import os
from pathlib import Path

from servobench.errors import UsageError
from servobench.recording.reader import read
from servobench.recording.recording import Recording
from servobench.recording.writer import save


def recover(path: str | os.PathLike[str], to: str | os.PathLike[str]) -> tuple[Recording, ...]:
    """Write what can be read of the native file `path` to the new file `to`, and return it; the original stays as it is.

    The last recording has the finding `recording-cut-short` where anything was left out, and keeps it in the copy.
    Raises `UsageError` where `to` is there already, `FormatError` where nothing can be read, and `StorageError` where the
    copy can't be written.
    """
    if Path(to).exists():
        raise UsageError(f"{to} is there already; give a new name for the recovered copy")
    recordings = read(path)
    save(recordings, to)
    return recordings

"""Recovers a torn recording: its intact part, as a complete file beside it or in its place."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryDirectory

from servobench.core.errors import StorageError, UsageError
from servobench.recordings.native.lease import is_held
from servobench.recordings.native.mcap_file import PART, busy_text
from servobench.recordings.native.reader import read
from servobench.recordings.native.writer import save
from servobench.recordings.recording import Recording


def recover(path: str | os.PathLike[str], to: str | os.PathLike[str]) -> tuple[Recording, ...]:
    """Write what can be read of the native file `path` to the new file `to`, and return it; the original stays as it is.

    The last recording has the finding `recording-cut-short` where anything was left out, and keeps it in the copy.
    Raises `UsageError` where `to` is there already, `FormatError` where nothing can be read, and `StorageError` where the
    copy can't be written.
    """
    if Path(to).exists():
        raise UsageError(f"{to} exists already; give a new name for the recovered copy")
    recordings = read(path)
    save(recordings, to)
    return recordings


def make_whole(path: str | os.PathLike[str]) -> tuple[Recording, ...]:
    """Write what can be read of the part that became of the native file `path` to `path` itself, and return it.

    The part is removed once the whole file is there and was read back. Raises what `recover` does, `StorageError` where
    the whole file doesn't hold what was written to it, and `UsageError` where there
    is no part, or one that is still being written, or a file called `path` as well, which may hold more than the part.
    """
    whole = Path(path)
    part = whole.with_name(f"{whole.name}{PART}")
    if not part.exists():
        raise UsageError(f"there is no unfinished recording {part}, so there is nothing to recover")
    if is_held(part):
        raise UsageError(busy_text(part))
    if whole.exists():
        raise UsageError(
            f"{whole} exists as well as {part.name}: look at both (servobench inspect), and remove or rename the one "
            "that holds less"
        )
    with TemporaryDirectory(prefix=".", dir=whole.parent) as folder:
        new = Path(folder) / whole.name
        recordings = recover(part, new)
        if read(new) != recordings:
            raise StorageError(
                f"{new} doesn't contain what was written to it; {part} is kept: copy it to another disk"
            )
        new.replace(whole)
    part.unlink()
    return recordings

"""The recordings that a command line names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servobench.cli.progress import Progress
    from servobench.recording.recording import Recording


def loaded(files: Sequence[Path], progress: Progress) -> list[Recording]:
    """Return all recordings in some files, in their order."""
    from servobench.formats.base import load

    recordings: list[Recording] = []
    progress.begin("reading")
    for number, file in enumerate(files):
        progress.reached(number / len(files))
        recordings += load(file)
    return recordings


def chosen(recordings: Sequence[Recording], names: Sequence[str]) -> list[Recording]:
    """Return the recordings that have one of some names, all of them where there are no names.

    Raises `UnknownName`, which lists the names that there are.
    """
    from servobench.errors import UnknownName

    known = [recording.name for recording in recordings]
    for name in names:
        if name not in known:
            raise UnknownName("recording", name, known)
    return [recording for recording in recordings if not names or recording.name in names]

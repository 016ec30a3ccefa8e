"""Recordings of a panel that was killed while recording: they are recovered and listed as any other."""

from __future__ import annotations

from contextlib import suppress
from datetime import datetime
from pathlib import Path

from servobench.core.errors import FormatError, ServobenchError, UsageError
from servobench.panel.capture import about
from servobench.panel.library import ABOUT, EXPERIMENT, RECORDING, Library, keep_about
from servobench.recordings.native.lease import is_held
from servobench.recordings.native.mcap_file import PART
from servobench.rig.experiment import read_experiment


def complete_leftovers(library: Library, being_made: str | None) -> None:
    """Complete all recordings that no process writes any more; `being_made` is the name of the one that this panel writes.

    A part that a recorder still writes is left to it, and one that can't be read to `servobench recover`, which says why.
    Raises `StorageError` where nothing can be written.
    """
    for folder in library.folders():
        if folder.name != being_made and not (folder / ABOUT).exists():
            with suppress(FormatError, UsageError):
                _complete(folder)


def _complete(folder: Path) -> None:
    from servobench.recordings.native.recover import make_whole

    recording = folder / RECORDING
    part = recording.with_name(f"{RECORDING}{PART}")
    if part.exists():
        if is_held(part):
            return
        make_whole(recording)
    if recording.is_file() and not recording.is_symlink():
        keep_about(folder, about(recording, _start_time(folder), _signal(folder)))


def _start_time(folder: Path) -> str:
    """The run's start in local time: the experiment is written just before, and never again."""
    experiment = folder / EXPERIMENT
    file = experiment if experiment.exists() else folder / RECORDING
    return datetime.fromtimestamp(file.stat().st_mtime).isoformat(timespec="seconds")


def _signal(folder: Path) -> str:
    """The kind of the signal; empty if unknown."""
    try:
        text = (folder / EXPERIMENT).read_text(encoding="utf-8")
        return str(read_experiment(text, EXPERIMENT).model_dump()["signal"]["type"])
    except (OSError, ValueError, ServobenchError):
        return ""

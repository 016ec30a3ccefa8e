"""The recordings and results that a command line names."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servobench.cli.options import Reading
    from servobench.cli.progress import Progress
    from servobench.export.summary import ResultSummary
    from servobench.identification.result import Result
    from servobench.recordings.evidence import Evidence
    from servobench.recordings.recording import Recording


def load_all(files: Sequence[Path], progress: Progress, reading: Reading | None = None) -> list[Recording]:
    """Return all recordings in some files, in their order; `reading` decides where one may be read in two ways."""
    from servobench.recordings.reading import recordings_as_stated

    stated = {} if reading is None else reading.options
    recordings: list[Recording] = []
    progress.begin("reading")
    for number, file in enumerate(files):
        progress.advance(number / len(files))
        recordings += recordings_as_stated(file, **stated)
    return recordings


def evidence_of(recordings: Sequence[Recording], reading: Reading) -> list[Evidence]:
    """Return the recordings that are meant, with roles, units, times and chain as the command line says."""
    from servobench.recordings.evidence import Evidence
    from servobench.recordings.reading import evidence_in

    parts = evidence_in(list(recordings), **{**reading.options, "input_value": _values(recordings, reading)})
    return [part for part in parts if isinstance(part, Evidence)]


def _values(recordings: Sequence[Recording], reading: Reading) -> list[str] | None:
    """The stated input of each recording, where each file has its own; as it was typed where one is for all."""
    from servobench.core.errors import UsageError

    values = reading.input_value or None
    if values is None or len(values) == 1:
        return values
    files = list(dict.fromkeys(each.source.name for each in recordings))
    if len(values) != len(files):
        raise UsageError(
            f"`input_value=...` is given {len(values)} times for {len(files)} files; give it once, or once for each in their "
            "order"
        )
    return [values[files.index(each.source.name)] for each in recordings]


def further_evidence_of(recordings: Sequence[Recording], reading: Reading) -> list[Evidence]:
    """Return the same for additional recordings: all in their files."""
    from servobench.recordings.evidence import Evidence
    from servobench.recordings.reading import further_evidence_in

    parts = further_evidence_in(list(recordings), argument="--validate-with", **reading.options)
    return [part for part in parts if isinstance(part, Evidence)]


def motor_in(path: Path, reading: Reading, starts_at_rest: bool) -> ResultSummary:
    """Return what is known of a motor: a result, or what recordings in a file tell."""
    from servobench.export.summary import ResultSummary

    if is_result(path):
        refuse_reading(path, reading, starts_at_rest)
        return ResultSummary.read(path)
    return ResultSummary.of(identify_file(path, reading, starts_at_rest))


def identify_file(path: Path, reading: Reading, starts_at_rest: bool) -> Result:
    """Return what the recordings in a file tell of the motor, for a command that goes on from there."""
    from servobench.cli.conclusion import conclude
    from servobench.cli.progress import Progress, announce_compiling

    with Progress() as progress:
        evidence = evidence_of(load_all([path], progress, reading), reading)
        with announce_compiling(progress):
            return conclude(evidence, progress, starts_at_rest=starts_at_rest)


def is_result(path: Path) -> bool:
    """Return whether a path is that of a result, there or not: a run's folder, or JSON that isn't a recording."""
    if path.is_dir() or (not path.exists() and path.suffix in ("", ".json")):
        return True
    if path.suffix != ".json":
        return False
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return True  # which says in its own words what is wrong with it
    return isinstance(content, dict) and str(content.get("schema")).startswith("servobench.")


def refuse_reading(path: Path, reading: Reading, starts_at_rest: bool, usable: Sequence[str] = ()) -> None:
    """Raise `UsageError` for options that say how to read a recording where there is a result; `usable` are of use there, too."""
    from servobench.core.errors import UsageError

    flags = [*reading.flags, *(["--starts-at-rest"] if starts_at_rest else [])]
    useless = [each for each in flags if each not in usable]
    if useless:
        raise UsageError(
            f"{path} is a result, which has no columns to read: leave {' and '.join(useless)} out, or give the file with "
            "the recording"
        )

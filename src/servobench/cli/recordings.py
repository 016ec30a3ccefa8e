"""The recordings that a command line names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servobench.cli.conclusion import Evidence
    from servobench.cli.progress import Progress
    from servobench.identification.result import Result
    from servobench.recordings.formats.mapping import Mapping
    from servobench.recordings.recording import Recording


def loaded(files: Sequence[Path], progress: Progress) -> list[Recording]:
    """Return all recordings in some files, in their order."""
    from servobench.recordings.formats.base import load

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
    from servobench.core.errors import UnknownName

    known = [recording.name for recording in recordings]
    for name in names:
        if name not in known:
            raise UnknownName("recording", name, known)
    return [recording for recording in recordings if not names or recording.name in names]


def mapping_in(file: Path | None) -> Mapping:
    """Return the mapping in a file, one that says nothing where there is none; raises `UsageError` for one with mistakes."""
    from servobench.recordings.formats.mapping import Mapping

    return Mapping() if file is None else Mapping.read(file)


def mapped(recordings: Sequence[Recording], mapping: Mapping, said: Mapping) -> list[Evidence]:
    """Return the recordings that a mapping means, with roles, units, times and chain as it and the command line say.

    `said` is what the command line says, which comes before what the mapping says. Raises what `assign` does, and `UnknownName`
    where the mapping tells of a recording that there isn't.
    """
    meant = chosen(recordings, said.recordings or mapping.recordings)
    chosen(
        recordings, tuple(mapping.each)
    )  # a name that isn't there is a mistake, even where it would change nothing
    return [evidence(each, mapping.of(each.name).overridden_by(said)) for each in meant]


def evidence(recording: Recording, mapping: Mapping) -> Evidence:
    """Return a recording with roles, units and times as a mapping says, and its chain where it belongs."""
    from dataclasses import replace

    from servobench.cli.chain import with_chain

    return with_chain(replace(mapping, chain="").assigned(recording), mapping.chain)


def seconds(text: str | None) -> float | None:
    """Return the sample time in a text, with its unit or in seconds; raises `UsageError` where it can't be one."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.recordings.formats.timing import seconds as checked

    if text is None:
        return None
    try:
        return checked(text)
    except (UnitError, UsageError) as error:
        raise UsageError(f"--sample-time: {error}") from None


def identified_as_it_is(file: Path) -> Result:
    """Return what is identified from the recordings in a file, for a command that takes no columns and units.

    Raises `UsageError` where these have to be said: to `servobench identify`, whose result the command takes as well.
    """
    from servobench.core.errors import MissingInformation, UsageError
    from servobench.identification.identify import identify
    from servobench.recordings.formats.base import load
    from servobench.recordings.formats.mapping import Mapping
    from servobench.recordings.measurement.measure import measure

    try:
        found = [evidence(each, Mapping()) for each in load(file)]
        return identify([measure(each.recording, each.chain) for each in found])
    except MissingInformation as error:
        raise UsageError(
            f"{file} doesn't say enough to be identified as it is: {'; '.join(error.missing)}. Say so to "
            f"`servobench identify {file} --json`, keep what it prints in result.json, and give that in the place of {file}"
        ) from None

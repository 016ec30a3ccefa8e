"""The recordings that a command line names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servobench.cli.progress import Progress
    from servobench.identification.result import Result
    from servobench.recordings.evidence import Evidence
    from servobench.recordings.formats.mapping import Mapping
    from servobench.recordings.recording import Recording


def load_all(files: Sequence[Path], progress: Progress) -> list[Recording]:
    """Return all recordings in some files, in their order."""
    from servobench.recordings.loading.load import load

    recordings: list[Recording] = []
    progress.begin("reading")
    for number, file in enumerate(files):
        progress.advance(number / len(files))
        recordings += load(file)
    return recordings


def select(recordings: Sequence[Recording], names: Sequence[str]) -> list[Recording]:
    """Return the recordings that have one of some names, all of them where there are no names.

    Raises `UnknownName`, which lists the names that there are.
    """
    from servobench.core.errors import UnknownName

    known = [recording.name for recording in recordings]
    for name in names:
        if name not in known:
            raise UnknownName("recording", name, known)
    return [recording for recording in recordings if not names or recording.name in names]


def mapping_of(file: Path | None) -> Mapping:
    """Return the mapping in a file, one that says nothing where there is none; raises `UsageError` for one with mistakes."""
    from servobench.recordings.formats.mapping import Mapping

    return Mapping() if file is None else Mapping.read(file)


def input_values(files: Sequence[Path], values: Sequence[str], column: str | None) -> dict[str, str]:
    """Return the stated input of each file by its path: one for all, or one for each.

    Raises `UsageError` for another number of them, and beside a `column` of the input.
    """
    from servobench.core.errors import UsageError

    if not values:
        return {}
    if column is not None:
        raise UsageError(f"both `input={column}` and `input_value={values[0]}` are given; give one of them")
    if len(values) not in {1, len(files)}:
        raise UsageError(
            f"`input_value=...` is given {len(values)} times for {len(files)} files; give it once, or once for each in their "
            "order"
        )
    return dict(zip(map(str, files), values if len(values) > 1 else [*values] * len(files), strict=True))


def apply_mapping(
    recordings: Sequence[Recording],
    mapping: Mapping,
    said: Mapping,
    values: dict[str, str] | None = None,
) -> list[Evidence]:
    """Return the recordings that a mapping means, with roles, units, times and chain as it and the command line say.

    `said` is what the command line says, which comes before what the mapping says, and `values` the stated input of the files by
    their paths. Raises what `assign` does, and `UnknownName`
    where the mapping tells of a recording that there isn't.
    """
    from servobench.recordings.evidence import evidence_of

    meant = select(recordings, said.recordings or mapping.recordings)
    select(
        recordings, tuple(mapping.each)
    )  # a name that isn't there is a mistake, even where it would change nothing
    own = {name: said.override_with(type(said)(input_value=value)) for name, value in (values or {}).items()}
    return [
        evidence_of(each, mapping.of(each.name).override_with(own.get(each.source.name, said)))
        for each in meant
    ]


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


def identify_directly(file: Path) -> Result:
    """Return what is identified from the recordings in a file, for a command that takes no columns and units.

    Raises `UsageError` where these have to be said: to `servobench identify`, whose result the command takes as well.
    """
    from servobench.core.errors import MissingInformation, UsageError
    from servobench.identification.identify import identify

    try:
        return identify(file)
    except MissingInformation as error:
        raise UsageError(
            f"{file} doesn't contain enough to be identified: {'; '.join(error.missing)}. Give that to `servobench "
            f"identify {file} --json`, save the output as result.json, and use it instead of {file}"
        ) from None

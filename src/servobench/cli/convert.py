"""`servobench convert`: a recording in another file format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from servobench.recordings.formats.mapping import Mapping
    from servobench.recordings.recording import Recording


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", hidden=True)],
    target: Annotated[Path, typer.Argument(metavar="OUT", hidden=True)],
    recording: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Use only the recording of that name, if there are several; may be repeated."
        ),
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help=(
                "Write roles, units and times from this mapping; `servobench inspect IN --write-mapping` "
                "proposes one."
            ),
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False,
) -> None:
    """Write the recordings in a file in another format.

    The ending of OUT selects the format. Nothing is renamed, scaled or resampled. With a mapping, roles, units and times
    come from it, and samples without a usable time are left out.
    """
    from servobench.cli.progress import Progress
    from servobench.cli.recordings import load_all, mapping_of, select
    from servobench.cli.result_text import show_findings
    from servobench.cli.terminal import output, say
    from servobench.core.errors import UsageError
    from servobench.core.rounding import count_text
    from servobench.recordings.formats.base import save

    if target.exists() and not overwrite:
        raise UsageError(f"{target} exists already; give another name, or --overwrite to replace it")
    said = mapping_of(mapping)
    with Progress() as progress:
        recordings = select(load_all([source], progress), recording or said.recordings)
    if mapping is not None:
        recordings = [_as_said(each, said.of(each.name)) for each in recordings]
    save(recordings, target)
    console = output()
    say(console, f"{target}: {count_text(len(recordings), 'recording')} from {source}")
    show_findings(console, (finding for each in recordings for finding in each.findings))


def _as_said(recording: Recording, mapping: Mapping) -> Recording:
    """The recording as a mapping says; raises `UsageError` for a chain that is still to come: no file holds what it yields."""
    from servobench.core.errors import UsageError
    from servobench.recordings.evidence import evidence_of

    found = evidence_of(recording, mapping)
    if found.chain:
        raise UsageError(
            f"{recording.name}: the output `{found.recording.output}` hasn't passed the chain `{found.chain}` yet; "
            "remove the chain from the mapping here, and give it to `servobench identify`"
        )
    return found.recording

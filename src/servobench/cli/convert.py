"""`servobench convert`: a recording in another file format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", hidden=True)],
    target: Annotated[Path, typer.Argument(metavar="OUT", hidden=True)],
    recording: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Take the recording of that name only, of several; may be repeated."
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it is there.")] = False,
) -> None:
    """Write the recordings in a file in another format.

    The ending of OUT says which. What is written is what IN says: nothing is renamed, scaled or resampled.
    """
    from servobench.cli.answer import show_findings
    from servobench.cli.progress import Progress
    from servobench.cli.recordings import chosen, loaded
    from servobench.cli.terminal import output, say
    from servobench.errors import UsageError
    from servobench.formats.base import save
    from servobench.rounding import counted

    if target.exists() and not overwrite:
        raise UsageError(f"{target} is there already; give another name, or --overwrite to replace it")
    with Progress() as progress:
        recordings = chosen(loaded([source], progress), recording or ())
    save(recordings, target)
    console = output()
    say(console, f"{target}: {counted(len(recordings), 'recording')} from {source}")
    show_findings(console, (finding for each in recordings for finding in each.findings))

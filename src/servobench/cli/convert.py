"""`servobench convert`: a recording in another file format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="A recording, in any known format.")],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="The file to write; its ending says the format.")
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it is there.")] = False,
) -> None:
    """Write a recording in another format; what can't be kept is told.

    What is written is what the file says: no column is renamed, scaled or resampled.
    """
    from servobench.cli.answer import show_findings
    from servobench.cli.terminal import output
    from servobench.errors import UsageError
    from servobench.formats.base import load, save

    if target.exists() and not overwrite:
        raise UsageError(f"{target} is there already; give another name, or --overwrite to replace it")
    recordings = load(source)
    save(recordings, target)
    console = output()
    console.print(f"{target}: {len(recordings)} recording(s) from {source}", soft_wrap=True)
    show_findings(console, (finding for each in recordings for finding in each.findings))

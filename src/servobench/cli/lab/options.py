"""Arguments and options that several commands of `servobench lab` share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Name = Annotated[str, typer.Argument(metavar="NAME|FILE.md", hidden=True)]
Roster = Annotated[Path, typer.Argument(metavar="ROSTER.csv", hidden=True)]
Folder = Annotated[
    Path | None,
    typer.Option(
        "--folder",
        metavar="DIR",
        help="A folder with exercises of your own, in place of those that come along.",
    ),
]
Studies = Annotated[
    bool,
    typer.Option(
        "--studies",
        help="Show what comes out and where the paper errs, which gives most answers away; a page has it open then.",
    ),
]
Solution = Annotated[
    bool, typer.Option("--solution", help="Show the right answers beside the blanks, and what comes out.")
]
WithMotor = Annotated[
    bool,
    typer.Option(
        "--with-motor",
        help="The students have their motors in panels as well: ask what takes further runs, too.",
    ),
]

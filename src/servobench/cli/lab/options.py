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
        help="A folder with exercises of your own, instead of the built-in ones.",
    ),
]
Studies = Annotated[
    bool,
    typer.Option(
        "--studies",
        help="Show the results and the paper's errors, which gives most answers away; a page shows them unfolded.",
    ),
]
Solution = Annotated[
    bool, typer.Option("--solution", help="Show the right answers beside the blanks, and the results.")
]
WithMotor = Annotated[
    bool,
    typer.Option(
        "--with-motor",
        help="The students also have their motors in panels: include questions that need further runs.",
    ),
]

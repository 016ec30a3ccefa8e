"""`servobench lab page`: exercises as pages in a folder."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.lab.options import Folder, Solution, Studies
from servobench.cli.options import AsJson, DeviceName

if TYPE_CHECKING:
    from servobench.lab.page import InPart


def page(
    names: Annotated[list[str] | None, typer.Argument(metavar="NAME|FILE.md", hidden=True)] = None,
    folder: Folder = None,
    studies: Studies = False,
    solution: Solution = False,
    device: DeviceName = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="The folder to write to; by default a new one named after the time."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write exercises as pages into a folder: those named, or all.

    The pages link to each other; start at `index.html`.
    """
    from servobench.cli.failures import PartialStop
    from servobench.cli.lab.exercises import exercise_by_name, exercise_folder, motor_stand
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.run import terminate_like_ctrl_c
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.core.errors import UsageError
    from servobench.lab.document import to_dict
    from servobench.lab.exercise_file import exercises
    from servobench.lab.page import INDEX, InPart, write_lab
    from servobench.lab.worked_exercise import WorkedExercise

    where = exercise_folder(folder)
    selection = [exercise_by_name(name, folder) for name in dict.fromkeys(names or ())] or exercises(where)
    if not selection:
        raise UsageError(f"there are no exercises in {where}; expected files NAME.md")
    with (
        empty_folder(out, "lab", datetime.now()) as target,
        Progress() as progress,
        announce_compiling(progress),
        terminate_like_ctrl_c(),
    ):
        lab = [WorkedExercise(exercise=each, stand=motor_stand(each, device), given={}) for each in selection]
        progress.begin(f"doing {len(lab)} exercises")

        def show_progress(number: int, worked: WorkedExercise) -> None:
            progress.advance(number / len(lab))

        try:
            write_lab(target, lab, solution=solution, studies=studies, begun=show_progress)
        except InPart as interrupt:
            raise PartialStop(_partial_text(interrupt)) from None
    console = messages() if as_json else output()
    say(console, f"{len(lab)} exercise{'s' if len(lab) > 1 else ''}: {target / INDEX}")
    if as_json:
        print_json(to_dict(lab, solution=solution))


def _partial_text(interrupt: InPart) -> str:
    from servobench.lab.page import INDEX

    if not interrupt.done:
        return f"interrupted before the first of {interrupt.of} exercises was done; there is no page in {interrupt.folder}"
    return (
        f"interrupted: {interrupt.done} of {interrupt.of} exercises are in {interrupt.folder}, and its {INDEX} lists the missing "
        "ones; to get all of them, run it again with another --out, or delete that folder first"
    )

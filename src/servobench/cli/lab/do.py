"""`servobench lab do`: do an exercise, show it, and check answers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from servobench.cli.failures import DONE
from servobench.cli.lab.options import Folder, Name, Solution, Studies
from servobench.cli.options import AsJson, DeviceName, Overwrite


def do(
    name: Name,
    folder: Folder = None,
    answers: Annotated[
        list[str] | None,
        typer.Option(
            "--answer",
            metavar="BLANK=VALUE",
            help='An answer to check, such as "gain=23.4 rad/(s*V)"; may be repeated.',
        ),
    ] = None,
    studies: Studies = False,
    solution: Solution = False,
    device: DeviceName = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            "--recorded",
            metavar="FILE",
            help="A recording of the exercise's experiment that servobench made, instead of a new run.",
        ),
    ] = None,
    page: Annotated[
        Path | None, typer.Option(metavar="PAGE.html", help="Also write it as a page (HTML).")
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Do an exercise, which `lab list` lists, or check answers to it.

    It is done on the simulated motor, in virtual time, or on a device.
    """
    from servobench.cli.lab.exercises import exercise_by_name, motor_stand, stand_of_recording
    from servobench.cli.lab.shown import show_checked, show_worked
    from servobench.cli.output_file import check_free
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.run import status_after, terminate_like_ctrl_c
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.core.errors import UsageError
    from servobench.lab.document import to_dict
    from servobench.lab.page import write_exercise
    from servobench.lab.worked_exercise import WorkedExercise

    if recording is not None and device is not None:
        raise UsageError(
            "--recorded and --device don't go together, as a recording by servobench names its device; leave "
            "--device out"
        )
    check_free(page, "--page", [recording], overwrite)
    exercise = exercise_by_name(name, folder)
    answers_by_blank = _answers(answers or ())
    for blank in answers_by_blank:
        exercise.blank(blank)  # a misspelt one is an error before anything is run
    with Progress() as progress, announce_compiling(progress), terminate_like_ctrl_c():
        progress.begin(f"doing {exercise.name}")
        stand = stand_of_recording(exercise, recording) if recording else motor_stand(exercise, device)
        worked = WorkedExercise(exercise=exercise, stand=stand, given=answers_by_blank)
        answered = to_dict([worked], solution=solution)
        if page is not None:
            write_exercise(worked, page, solution=solution, studies=studies)
    console = messages() if as_json else output()
    if answers_by_blank:
        show_checked(console, worked)
    else:
        show_worked(console, worked, solution=solution, studies=studies)
    if as_json:
        print_json(answered)
    if page is not None:
        say(console, f"\npage: {page}")
    raise typer.Exit(DONE if recording else status_after(worked.stand.recording))


def _answers(texts: Sequence[str]) -> dict[str, str]:
    from servobench.core.errors import UsageError

    answers_by_blank: dict[str, str] = {}
    for blank, value in map(_answer, texts):
        if blank in answers_by_blank:
            raise UsageError(
                f"--answer gives two values for {blank!r}, {answers_by_blank[blank]!r} and {value!r}; leave one of them out"
            )
        answers_by_blank[blank] = value
    return answers_by_blank


def _answer(text: str) -> tuple[str, str]:
    from servobench.core.errors import UsageError

    blank, equals, value = text.partition("=")
    if not equals or not blank.strip() or not value.strip():
        raise UsageError(
            f'--answer {text!r} is no answer; expected the name of a blank and a value, such as "gain=23.4"'
        )
    return blank.strip(), value.strip()

"""`servobench lab`: the exercises, listed, worked through, and written as pages."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.failures import DONE

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.lab.exercise import Exercise
    from servobench.lab.page import InPart
    from servobench.lab.stand import MotorStand
    from servobench.lab.worked import Worked


def lab(
    name: Annotated[str | None, typer.Argument(metavar="[NAME | FILE.md]", hidden=True)] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="All exercises, as pages that lead to each other.")
    ] = False,
    folder: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="A folder with exercises of your own, in place of those that come along."
        ),
    ] = None,
    answers: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BLANK=VALUE | DIR",
            help='An answer to check, such as "gain=23.4 rad/(s*V)"; may be repeated. With --marks the folder of the forms.',
        ),
    ] = None,
    solution: Annotated[
        bool, typer.Option("--solution", help="Show the right answers beside the blanks, and what comes out.")
    ] = False,
    studies: Annotated[
        bool,
        typer.Option(
            "--studies", help="Show what comes out, which gives most answers away; a page has it open then."
        ),
    ] = False,
    device: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="The device, in place of the exercise's; see `servobench devices`."
        ),
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="A recording of the exercise's experiment that servobench made, in place of a run.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="PAGE.html | DIR",
            help="Where to write the page; with --all or --assess the folder, without one called after the time.",
        ),
    ] = None,
    roster: Annotated[
        Path | None,
        typer.Option(
            "--assess",
            metavar="ROSTER.csv",
            help="Make a motor, a recording and a form for each student in a table; with --marks mark the forms.",
        ),
    ] = None,
    secret: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="The secret that the students' motors are drawn from; made where there is none.",
        ),
    ] = None,
    with_motor: Annotated[
        bool,
        typer.Option(
            "--with-motor",
            help="The students have their motors in panels as well: ask what takes further runs, too.",
        ),
    ] = False,
    marks: Annotated[
        Path | None,
        typer.Option(metavar="MARKS.csv", help="Where to write the marks of the forms in --answers DIR."),
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print what comes out as JSON, and nothing else, on standard output."),
    ] = False,
) -> None:
    """Do an exercise: its text and what to fill in; --studies for what comes out, and where the paper errs.

    Without a name the exercises are listed. With one it is done on the simulated motor, in virtual time, or on a device.
    An exercise is a Markdown file: docs/how-to/exercise.md says how to write one.
    """
    from servobench.cli.assess import assess, check_assessment, mark
    from servobench.cli.run import status_after
    from servobench.cli.terminal import messages, output
    from servobench.core.errors import UsageError
    from servobench.lab.exercise_file import FOLDER

    check_assessment(
        name=name,
        roster=roster,
        secret=secret,
        marks=marks,
        answers=answers,
        with_motor=with_motor,
        out=out,
        others=(
            ("--all", everything),
            ("--recording", recording),
            ("--device", device),
            ("--solution", solution),
        ),
    )
    if roster is None:
        _check_together(name, everything, recording, device, answers, as_json, out)
    where = folder or FOLDER
    if folder is not None and not folder.is_dir():
        raise UsageError(f"--folder {folder}: is no folder; expected one with exercises, NAME.md")
    console = messages() if as_json else output()
    if everything:
        _write_all(console, where, device, out, solution=solution, studies=studies, as_json=as_json)
    elif name is None:
        _list(console, where)
    elif roster is not None and secret is not None:
        found = _asked_for(name, where)
        if marks is None:
            assess(console, found, roster, secret, out=out, with_motor=with_motor, as_json=as_json)
        else:
            folder_of_forms = Path((answers or [""])[0])
            mark(
                console,
                found,
                roster,
                secret,
                answers=folder_of_forms,
                marks=marks,
                with_motor=with_motor,
                as_json=as_json,
            )
    else:
        found = _asked_for(name, where)
        given = _answers(answers or ())
        for blank in given:
            found.blank(blank)  # a misspelt one is told before anything is run
        worked = _one(
            console, found, device, recording, given, out, solution=solution, studies=studies, as_json=as_json
        )
        if recording is None:
            raise typer.Exit(status_after(worked.stand.recording))
    raise typer.Exit(DONE)


def _check_together(
    name: str | None,
    everything: bool,
    recording: Path | None,
    device: str | None,
    answers: Sequence[str] | None,
    as_json: bool,
    out: Path | None,
) -> None:
    from servobench.cli.conclusion import check_report
    from servobench.core.errors import UsageError

    if everything and name is not None:
        raise UsageError(f"--all and the exercise {name!r} don't go together; give one of them")
    if everything and (recording is not None or answers):
        raise UsageError(
            "--all goes with neither --recording nor --answers; name the exercise that they belong to"
        )
    if recording is not None and device is not None:
        raise UsageError(
            "--recording and --device don't go together, as a recording of servobench's own says what device it is of; leave "
            "--device out"
        )
    if name is None and not everything:
        for option, given in (
            ("--answers", answers),
            ("--recording", recording),
            ("--out", out),
            ("--json", as_json),
        ):
            if given:
                raise UsageError(
                    f"{option} belongs to an exercise; name one, or give --all: servobench lab lists them"
                )
    if not everything:
        check_report(out, [recording] if recording else [], option="--out")


def _list(console: Console, folder: Path) -> None:
    """Print the exercises in their order; those with mistakes are told, and end the command as a mistake does."""
    from servobench.cli.layout import show_table
    from servobench.core.errors import ServobenchError, UsageError
    from servobench.lab.exercise_file import exercise, names

    found: list[Exercise] = []
    mistakes: list[str] = []
    for name in names(folder):
        try:
            found.append(exercise(name, folder))
        except ServobenchError as error:  # one file with a mistake doesn't hide the others
            mistakes.append(str(error))
    if not found and not mistakes:
        raise UsageError(f"there are no exercises in {folder}; expected files NAME.md")
    found.sort(key=lambda each: (each.order, each.name))
    rows = [(each.name, _told(each)) for each in found]
    show_table(console, ("name", "what it is about"), rows)
    if mistakes:
        raise UsageError("\n".join(mistakes))


def _told(exercise: Exercise) -> str:
    """Its title, and what it is about, as two sentences."""
    from servobench.lab.formula import line_text

    title = line_text(exercise.title)
    return f"{title}{'' if title.endswith(('.', '?', '!')) else '.'} {line_text(exercise.sentence)}".rstrip()


def _asked_for(name: str, folder: Path) -> Exercise:
    from servobench.lab.exercise_file import exercise, load_exercise

    return load_exercise(Path(name)) if name.endswith(".md") else exercise(name, folder)


def _answers(texts: Sequence[str]) -> dict[str, str]:
    from servobench.core.errors import UsageError

    given: dict[str, str] = {}
    for blank, value in map(_answer, texts):
        if blank in given:
            raise UsageError(
                f"--answers has two for {blank!r}, {given[blank]!r} and {value!r}; leave one of them out"
            )
        given[blank] = value
    return given


def _answer(text: str) -> tuple[str, str]:
    from servobench.core.errors import UsageError

    blank, equals, value = text.partition("=")
    if not equals or not blank.strip() or not value.strip():
        raise UsageError(
            f'--answers {text!r} is no answer; expected the name of a blank and a value, such as "gain=23.4"'
        )
    return blank.strip(), value.strip()


def _stand(exercise: Exercise, device: str | None, recording: Path | None) -> MotorStand:
    from servobench.cli.run import check_named_alone
    from servobench.core.errors import UnknownName, UsageError
    from servobench.lab.stand import check_made_for, stand_of, stand_on_the_twin, stand_with
    from servobench.recordings.formats.base import load
    from servobench.rig.experiment.experiment import DeviceChoice

    if recording is not None:
        made = load(recording)
        if len(made) != 1:
            raise UsageError(f"{recording} holds {len(made)} recordings; expected one of this exercise")
        stand = stand_of(exercise, made[0], str(recording))
        check_made_for(exercise, made[0], str(recording))
        return stand
    asked = exercise.experiment.device
    if device is None and asked.name == "twin":
        return stand_on_the_twin(exercise)
    if device is None or device == asked.name:
        try:
            return stand_with(exercise, asked)
        except UnknownName as error:
            if device is not None:
                raise
            raise UsageError(
                f"{exercise.source}: the table [device]: {error}; mend it, or give --device"
            ) from None
    # The settings in the file are another device's.
    check_named_alone(
        device,
        f'in an exercise of your own, with name = "{device}" in [device] and the settings in [device.settings]; for a recording '
        "that there is take --recording FILE with the exercise's name, in place of --device",
    )
    return stand_with(exercise, DeviceChoice(name=device))


def _one(
    console: Console,
    exercise: Exercise,
    device: str | None,
    recording: Path | None,
    given: dict[str, str],
    out: Path | None,
    *,
    solution: bool,
    studies: bool,
    as_json: bool,
) -> Worked:
    from servobench.cli.lab_shown import show_checked, show_worked
    from servobench.cli.progress import Progress, told_when_compiling
    from servobench.cli.run import ended_like_ctrl_c
    from servobench.cli.terminal import print_json, say
    from servobench.lab.document import to_dict
    from servobench.lab.page import write_exercise
    from servobench.lab.worked import Worked

    with Progress() as progress, told_when_compiling(progress), ended_like_ctrl_c():
        progress.begin(f"doing {exercise.name}")
        worked = Worked(exercise=exercise, stand=_stand(exercise, device, recording), given=given)
        answered = to_dict([worked], solution=solution)
        if out is not None:
            write_exercise(worked, out, solution=solution, studies=studies)
    if not given:
        show_worked(console, worked, solution=solution, studies=studies)
    else:
        show_checked(console, worked)
    if as_json:
        print_json(answered)
    if out is not None:
        say(console, f"\npage: {out}")
    return worked


def _write_all(
    console: Console,
    folder: Path,
    device: str | None,
    out: Path | None,
    *,
    solution: bool,
    studies: bool,
    as_json: bool,
) -> None:
    from servobench.cli.failures import KeptInPart
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.progress import Progress, told_when_compiling
    from servobench.cli.run import ended_like_ctrl_c
    from servobench.cli.terminal import print_json, say
    from servobench.core.errors import UsageError
    from servobench.lab.document import to_dict
    from servobench.lab.exercise_file import exercises
    from servobench.lab.page import INDEX, InPart, write_lab
    from servobench.lab.worked import Worked

    found = exercises(folder)
    if not found:
        raise UsageError(f"there are no exercises in {folder}; expected files NAME.md")
    with (
        empty_folder(out, "lab", datetime.now()) as target,
        Progress() as progress,
        told_when_compiling(progress),
        ended_like_ctrl_c(),
    ):
        lab = [Worked(exercise=each, stand=_stand(each, device, None), given={}) for each in found]
        progress.begin(f"doing {len(lab)} exercises")

        def begun(number: int, worked: Worked) -> None:
            progress.reached(number / len(lab))

        try:
            write_lab(target, lab, solution=solution, studies=studies, begun=begun)
        except InPart as interrupt:
            raise KeptInPart(_kept(interrupt)) from None
    say(console, f"{len(lab)} exercises: {target / INDEX}")
    if as_json:
        print_json(to_dict(lab, solution=solution))


def _kept(interrupt: InPart) -> str:
    from servobench.lab.page import INDEX

    if not interrupt.done:
        return f"interrupted before the first of {interrupt.of} exercises was done; there is no page in {interrupt.folder}"
    return (
        f"interrupted: {interrupt.done} of {interrupt.of} exercises are in {interrupt.folder}, whose {INDEX} says which are "
        "missing; for all of them run it again with another --out, or delete that folder first"
    )

"""`servobench lab mark`: marks for the forms that a class hands in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from servobench.cli.lab.options import Folder, Name, Roster, WithMotor
from servobench.cli.options import AsJson

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.lab.assessment.marking import Marks
    from servobench.lab.exercise import Exercise

MARKS = "servobench.marks/1"


def mark(
    name: Name,
    roster: Roster,
    secret: Annotated[
        Path, typer.Option(metavar="FILE", help="The secret that the students' motors were drawn from.")
    ],
    forms: Annotated[
        Path, typer.Option(metavar="DIR", help="The folder with the returned forms, and folders in it.")
    ],
    marks: Annotated[Path, typer.Option(metavar="MARKS.csv", help="Where to write the marks.")],
    folder: Folder = None,
    with_motor: WithMotor = False,
    as_json: AsJson = False,
) -> None:
    """Mark the forms that a class hands back.

    Each is compared with the student's own motor.
    """
    from servobench.cli.lab.exercises import exercise_by_name
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.run import terminate_like_ctrl_c
    from servobench.cli.terminal import messages, output, print_json
    from servobench.lab.assessment.assigned_stand import Assessment
    from servobench.lab.assessment.forms import forms_in
    from servobench.lab.assessment.marking import check_there_are_forms, marks_table
    from servobench.lab.assessment.marking import mark as marks_of
    from servobench.lab.assessment.roster import read_roster
    from servobench.report.document import write_page
    from servobench.rig.motor.secret import read_secret

    exercise = exercise_by_name(name, folder)
    students = read_roster(roster)
    assessment = Assessment(
        exercise=exercise, secret_file=secret, secret=read_secret(secret), with_motor=with_motor
    )
    _check_places(marks, forms, roster)
    handed_in, unread = forms_in(forms)
    check_there_are_forms(handed_in, unread, forms)
    with Progress() as progress, announce_compiling(progress), terminate_like_ctrl_c():
        progress.begin(f"marking {len(students)} students in {exercise.name}")
        class_marks = marks_of(assessment, students, handed_in, progress.advance)
    write_page(marks_table(class_marks), marks)
    console = messages() if as_json else output()
    _show_marks(console, class_marks, (*unread, *class_marks.stray), marks)
    if as_json:
        print_json(_marks_as_data(exercise, class_marks, (*unread, *class_marks.stray)))


def _check_places(marks: Path, forms: Path, roster: Path) -> None:
    from servobench.core.errors import UsageError

    if not forms.is_dir():
        raise UsageError(f"--forms {forms} isn't a folder; expected the one with the forms")
    if marks.suffix.lower() != ".csv":
        raise UsageError(f"--marks {marks}: expected the name of a table, such as marks.csv")
    if forms.resolve() in marks.resolve().parents:
        raise UsageError(
            f"--marks {marks} is among the forms in {forms}; the students' folder is no place for marks, so put it elsewhere"
        )
    if marks.resolve() == roster.resolve():
        raise UsageError(f"--marks {marks} is the roster; give another name")


def _show_marks(console: Console, class_marks: Marks, stray: Sequence[str], marks: Path) -> None:
    from servobench.cli.layout import show_table
    from servobench.cli.terminal import printable, say

    rows: list[Any] = []
    for each in class_marks.students:
        wrong = [f"{m.blank} {m.verdict}" for m in each.marks if m.verdict in ("wrong", "missing")]
        notes = "; ".join((*each.notes, *([", ".join(wrong)] if wrong and each.points else [])))
        rows.append((printable(each.student), f"{each.points} of {each.total}", printable(notes)))
    show_table(console, ("student", "points", "what is missing"), rows)
    for sentence in stray:
        say(console, f"! {sentence}")
    say(console, f"\nmarks: {marks}")


def _marks_as_data(exercise: Exercise, class_marks: Marks, stray: Sequence[str]) -> dict[str, Any]:
    return {
        "schema": MARKS,
        "exercise": exercise.name,
        "students": [
            {
                "student": each.student,
                "points": each.points,
                "of": each.total,
                "blanks": [
                    {"id": m.blank, "verdict": m.verdict, "given": m.given, "sentence": m.sentence}
                    for m in each.marks
                ],
                "notes": list(each.notes),
            }
            for each in class_marks.students
        ],
        "stray": list(stray),
    }

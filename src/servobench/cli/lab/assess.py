"""`servobench lab assess`: a motor of their own for each student, a recording of it and a form."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from servobench.cli.lab.options import Folder, Name, Roster, WithMotor
from servobench.cli.options import AsJson

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.lab.assessment.handout import Handout
    from servobench.lab.assessment.questions import Question
    from servobench.lab.exercise import Exercise

HANDED_OUT = "servobench.handed-out/1"


def assess(
    name: Name,
    roster: Roster,
    secret: Annotated[
        Path,
        typer.Option(
            metavar="FILE",
            help="The secret that the students' motors are drawn from; created if missing. Keep it to yourself.",
        ),
    ],
    folder: Folder = None,
    with_motor: WithMotor = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="The folder to write to; by default a new one named after the exercise and the time.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Make a motor, a recording and a form for each student.

    The roster is a table with a column `student`.
    """
    from servobench.cli.lab.exercises import exercise_by_name
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.run import terminate_like_ctrl_c
    from servobench.cli.terminal import messages, output, print_json
    from servobench.lab.assessment.assigned_stand import Assessment
    from servobench.lab.assessment.handout import hand_out
    from servobench.lab.assessment.roster import read_roster
    from servobench.rig.motor.secret import new_secret, read_secret

    exercise = exercise_by_name(name, folder)
    students = read_roster(roster)
    with (
        empty_folder(out, exercise.name, datetime.now()) as target,
        Progress() as progress,
        announce_compiling(progress),
        terminate_like_ctrl_c(),
    ):
        is_new = not secret.exists()
        assessment = Assessment(
            exercise=exercise,
            secret_file=secret,
            secret=new_secret(secret) if is_new else read_secret(secret),
            with_motor=with_motor,
        )
        progress.begin(f"{len(students)} motors for {exercise.name}")
        made = hand_out(assessment, students, target, progress.advance)
    console = messages() if as_json else output()
    _show_handed_out(console, exercise, made, target, secret, is_new=is_new, with_motor=with_motor)
    if as_json:
        print_json(_handout_data(exercise, made, target))


def _show_handed_out(
    console: Console,
    exercise: Exercise,
    made: Sequence[Handout],
    folder: Path,
    secret: Path,
    *,
    is_new: bool,
    with_motor: bool,
) -> None:
    from rich.text import Text

    from servobench.cli.layout import show_table, show_wrapped
    from servobench.cli.terminal import say
    from servobench.lab.assessment.questions import form_pass_rate, pass_rates, same_for_all
    from servobench.lab.exercise_file import FOLDER
    from servobench.lab.formula import line_text

    questions = [each.asked for each in made]
    passed, same = pass_rates(questions), same_for_all(questions)
    rows = []
    for column in zip(*questions, strict=True):
        blank, count = column[0].blank, sum(question.is_answerable for question in column)
        of = "all" if count == len(column) else "nobody" if not count else f"{count} of {len(column)}"
        whose = "" if count < 2 else "everybody's" if same[blank.id] else "own"
        part = _percent(passed[blank.id]) if count else ""
        rows.append((blank.id, of, whose, part, line_text(blank.label)))
    others = "others' answers pass"
    headings = ("blank", "asked of", "right answer", others, "what is asked for")
    show_table(console, headings, rows, right=(others,))
    if sentence := _forms_text(form_pass_rate(questions), same, passed):
        show_wrapped(console, Text(), sentence, hanging=0)
    for why, blanks in _blanks_by_reason(questions).items():
        show_wrapped(console, Text(f"{', '.join(blanks)}: "), _reason_text(why), hanging=2)
    if Path(exercise.source).parent == FOLDER:
        sentence = (
            "This exercise comes with servobench: its rules are public, and servobench can compute the "
            "answers from a recording."
        )
        show_wrapped(console, Text(), sentence, hanging=0)
    for each in made:
        if each.cut_short:
            say(console, f"! the run of {each.student.id} ended early: {each.cut_short}")
    say(console, f"\n{len(made)} folders: {folder}")
    again = " --with-motor" if with_motor else ""
    say(
        console,
        f"{'a new secret' if is_new else 'the secret'}: {secret}. Keep it safe and private: marking needs it, and "
        "it reveals the motors",
    )
    say(
        console,
        f"later: servobench lab mark {exercise.name} ROSTER.csv --secret {secret}{again} --forms DIR --marks marks.csv",
    )


def _forms_text(whole: float, same: Mapping[str, bool], passed: Mapping[str, float]) -> str:
    """The sentence about whole forms, and about answers that are the same for everybody; empty with a single student."""
    if math.isnan(whole):
        return ""
    text = f"In {_percent(whole)} of all pairs, students could hand in each other's whole form and pass."
    if all(same[blank] for blank, part in passed.items() if not math.isnan(part)):
        return (
            f"{text} No question depends on the student's motor: everybody's answers are the same, so the marks "
            "can't show who did the work."
        )
    blanks = ", ".join(blank for blank, is_same in same.items() if is_same)
    return (
        f"{text} The same for everybody (a definition or a data sheet gives it): {blanks}."
        if blanks
        else text
    )


def _blanks_by_reason(questions: Sequence[tuple[Question, ...]]) -> dict[str, list[str]]:
    """The blanks that not every student is asked, by the reason."""
    reasons: dict[str, list[str]] = {}
    for column in zip(*questions, strict=True):
        question = next((question for question in column if not question.is_answerable), None)
        if question is not None:
            reasons.setdefault(question.why_not, []).append(question.blank.id)
    return reasons


def _reason_text(why: str) -> str:
    """The exercise's reason why a blank isn't asked of some or all students."""
    return f"not asked if it can't be determined: {why}"


def _percent(part: float) -> str:
    from servobench.core.rounding import plain

    return "-" if math.isnan(part) else f"{plain(100 * part, 2)} %"


def _handout_data(exercise: Exercise, made: Sequence[Handout], folder: Path) -> dict[str, Any]:
    from servobench.lab.assessment.questions import form_pass_rate, pass_rates, same_for_all

    questions = [each.asked for each in made]
    passed, same = pass_rates(questions), same_for_all(questions)
    return {
        "schema": HANDED_OUT,
        "exercise": exercise.name,
        "folder": str(folder),
        "students": [
            {"student": each.student.id, "folder": each.student.folder, "cut_short": each.cut_short or None}
            for each in made
        ],
        "blanks": [
            {
                "id": column[0].blank.id,
                "asked_of": sum(question.is_answerable for question in column),
                "same_for_all": same[column[0].blank.id],
                "passed_by_others": _finite(passed[column[0].blank.id]),
                "why_not": next((question.why_not for question in column if question.why_not), None),
            }
            for column in zip(*questions, strict=True)
        ],
        "forms_passed_by_others": _finite(form_pass_rate(questions)),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None

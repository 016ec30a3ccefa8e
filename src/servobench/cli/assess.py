"""`servobench lab EXERCISE --assess ROSTER.csv`: a motor of their own for each student, and marks for what they hand back."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.lab.assessment.handing_out import HandedOut
    from servobench.lab.assessment.marking import Marks
    from servobench.lab.assessment.questions import Question
    from servobench.lab.exercise import Exercise

HANDED_OUT, MARKS = "servobench.handed-out/1", "servobench.marks/1"


def check_assessment(
    *,
    name: str | None,
    roster: Path | None,
    secret: Path | None,
    marks: Path | None,
    answers: Sequence[str] | None,
    with_motor: bool,
    out: Path | None,
    others: Sequence[tuple[str, object]],
) -> None:
    """Raise `UsageError` for options that don't belong together: `others` are those that no assessment has."""
    from servobench.core.errors import UsageError

    if roster is None:
        own = {"--secret": secret is not None, "--marks": marks is not None, "--with-motor": with_motor}
        for option, is_given in own.items():
            if is_given:
                raise UsageError(
                    f"{option} belongs to an assessment: give --assess ROSTER.csv as well, a table with a column `student`"
                )
        return
    if name is None:
        raise UsageError("--assess belongs to an exercise; name one: servobench lab lists them")
    for option, given in others:
        if given:
            raise UsageError(f"--assess and {option} don't go together; give one of them")
    if secret is None:
        raise UsageError(
            "--assess needs --secret FILE: the motors are drawn from it; one that isn't there is made, and belongs to you alone"
        )
    if marks is None and answers:
        raise UsageError("--answers DIR goes with --marks MARKS.csv, where the marks are written")
    if marks is not None and (not answers or len(answers) != 1 or not Path(answers[0]).is_dir()):
        found = f", not {', '.join(answers)}" if answers else ""
        raise UsageError(f"--marks needs --answers DIR, the folder with the forms{found}")
    if marks is not None and out is not None:
        raise UsageError("--marks and --out don't go together: --out is where what is handed out is written")


def assess(
    console: Console,
    exercise: Exercise,
    roster: Path,
    secret: Path,
    *,
    out: Path | None,
    with_motor: bool,
    as_json: bool,
) -> None:
    """Hand an exercise out to a class."""
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.progress import Progress, told_when_compiling
    from servobench.cli.run import ended_like_ctrl_c
    from servobench.cli.terminal import print_json
    from servobench.lab.assessment.assigned_stand import Assessment
    from servobench.lab.assessment.handing_out import hand_out
    from servobench.lab.assessment.roster import read_roster
    from servobench.rig.motor.secret import new_secret, read_secret

    students = read_roster(roster)
    with (
        empty_folder(out, exercise.name, datetime.now()) as folder,
        Progress() as progress,
        told_when_compiling(progress),
        ended_like_ctrl_c(),
    ):
        is_new = not secret.exists()
        assessment = Assessment(
            exercise=exercise,
            secret_file=secret,
            secret=new_secret(secret) if is_new else read_secret(secret),
            with_motor=with_motor,
        )
        progress.begin(f"{len(students)} motors for {exercise.name}")
        made = hand_out(assessment, students, folder, progress.reached)
    _show_handed_out(console, exercise, made, folder, secret, is_new=is_new, with_motor=with_motor)
    if as_json:
        print_json(_handed_out_as_data(exercise, made, folder))


def mark(
    console: Console,
    exercise: Exercise,
    roster: Path,
    secret: Path,
    *,
    answers: Path,
    marks: Path,
    with_motor: bool,
    as_json: bool,
) -> None:
    """Mark what a class has handed back."""
    from servobench.cli.progress import Progress, told_when_compiling
    from servobench.cli.run import ended_like_ctrl_c
    from servobench.cli.terminal import print_json
    from servobench.lab.assessment.assigned_stand import Assessment
    from servobench.lab.assessment.forms import forms_in
    from servobench.lab.assessment.marking import check_there_are_forms, marks_table
    from servobench.lab.assessment.marking import mark as marks_of
    from servobench.lab.assessment.roster import read_roster
    from servobench.report.document import write_page
    from servobench.rig.motor.secret import read_secret

    students = read_roster(roster)
    assessment = Assessment(
        exercise=exercise, secret_file=secret, secret=read_secret(secret), with_motor=with_motor
    )
    _check_marks(marks, answers, roster)
    forms, unread = forms_in(answers)
    check_there_are_forms(forms, unread, answers)
    with Progress() as progress, told_when_compiling(progress), ended_like_ctrl_c():
        progress.begin(f"marking {len(students)} students in {exercise.name}")
        found = marks_of(assessment, students, forms, progress.reached)
    write_page(marks_table(found), marks)
    _show_marks(console, found, (*unread, *found.stray), marks)
    if as_json:
        print_json(_marks_as_data(exercise, found, (*unread, *found.stray)))


def _check_marks(marks: Path, answers: Path, roster: Path) -> None:
    from servobench.core.errors import UsageError

    if marks.suffix.lower() != ".csv":
        raise UsageError(f"--marks {marks}: expected the name of a table, such as marks.csv")
    if answers.resolve() in marks.resolve().parents:
        raise UsageError(
            f"--marks {marks}: lies among the forms in {answers}; put it elsewhere, the students' folder is no place for marks"
        )
    if marks.resolve() == roster.resolve():
        raise UsageError(f"--marks {marks}: is the roster; give another name")


def _show_handed_out(
    console: Console,
    exercise: Exercise,
    made: Sequence[HandedOut],
    folder: Path,
    secret: Path,
    *,
    is_new: bool,
    with_motor: bool,
) -> None:
    from rich.text import Text

    from servobench.cli.layout import show_table, show_wrapped
    from servobench.cli.terminal import say
    from servobench.lab.assessment.questions import all_passed_by_others, passed_by_others, same_for_all
    from servobench.lab.exercise_file import FOLDER
    from servobench.lab.formula import line_text

    asked = [each.asked for each in made]
    passed, same = passed_by_others(asked), same_for_all(asked)
    rows = []
    for column in zip(*asked, strict=True):
        blank, count = column[0].blank, sum(question.is_asked for question in column)
        of = "all" if count == len(column) else "nobody" if not count else f"{count} of {len(column)}"
        whose = "" if count < 2 else "everybody's" if same[blank.id] else "own"
        part = _percent(passed[blank.id]) if count else ""
        rows.append((blank.id, of, whose, part, line_text(blank.label)))
    others = "others' answers pass"
    headings = ("blank", "asked of", "right answer", others, "what is asked for")
    show_table(console, headings, rows, right=(others,))
    if sentence := _tells_apart(all_passed_by_others(asked), same, passed):
        show_wrapped(console, Text(), sentence, hanging=0)
    for why, blanks in _untold(asked).items():
        show_wrapped(console, Text(f"{', '.join(blanks)}: "), _not_asked(why), hanging=2)
    if Path(exercise.source).parent == FOLDER:
        sentence = "This exercise comes along: its rules are public, and servobench itself works the answers out of a recording."
        show_wrapped(console, Text(), sentence, hanging=0)
    for each in made:
        if each.cut_short:
            say(console, f"! the run of {each.student.id} ended before its time: {each.cut_short}")
    say(console, f"\n{len(made)} folders: {folder}")
    again = " --with-motor" if with_motor else ""
    say(
        console,
        f"{'a new secret' if is_new else 'the secret'}: {secret}. Keep it, and to yourself: without it there are no marks, "
        "and with it anybody knows the motors",
    )
    say(
        console,
        f"later: servobench lab {exercise.name} --assess ROSTER.csv --secret {secret}{again} --answers DIR --marks marks.csv",
    )


def _tells_apart(whole: float, same: Mapping[str, bool], passed: Mapping[str, float]) -> str:
    """What is to be said of whole forms, and of answers that are everybody's; empty with one student alone."""
    if math.isnan(whole):
        return ""
    said = f"Of all pairs of students, {_percent(whole)} could hand in each other's whole form and pass."
    if all(same[blank] for blank, part in passed.items() if not math.isnan(part)):
        return (
            f"{said} Nothing that is asked hangs on whose motor it is: expect the same answers from everybody, and no mark that "
            "tells who did the work."
        )
    blanks = ", ".join(blank for blank, is_same in same.items() if is_same)
    return (
        f"{said} The same for everybody, as a definition or a data sheet gives it: {blanks}."
        if blanks
        else said
    )


def _untold(asked: Sequence[tuple[Question, ...]]) -> dict[str, list[str]]:
    """The blanks that somebody isn't asked, by the reason."""
    reasons: dict[str, list[str]] = {}
    for column in zip(*asked, strict=True):
        question = next((question for question in column if not question.is_asked), None)
        if question is not None:
            reasons.setdefault(question.why_not, []).append(question.blank.id)
    return reasons


def _not_asked(why: str) -> str:
    """Why nobody, or not everybody, is asked a blank, in the words of the one who can't be."""
    return f"not asked where it can't be told: {why}"


def _percent(part: float) -> str:
    from servobench.core.rounding import plain

    return "-" if math.isnan(part) else f"{plain(100 * part, 2)} %"


def _show_marks(console: Console, found: Marks, stray: Sequence[str], marks: Path) -> None:
    from servobench.cli.layout import show_table
    from servobench.cli.terminal import printable, say

    rows: list[Any] = []
    for each in found.students:
        wrong = [f"{m.blank} {m.verdict}" for m in each.marks if m.verdict in ("wrong", "missing")]
        said = "; ".join((*each.notes, *([", ".join(wrong)] if wrong and each.points else [])))
        rows.append((printable(each.student), f"{each.points} of {each.total}", printable(said)))
    show_table(console, ("student", "points", "what is missing"), rows)
    for sentence in stray:
        say(console, f"! {sentence}")
    say(console, f"\nmarks: {marks}")


def _handed_out_as_data(exercise: Exercise, made: Sequence[HandedOut], folder: Path) -> dict[str, Any]:
    from servobench.lab.assessment.questions import all_passed_by_others, passed_by_others, same_for_all

    asked = [each.asked for each in made]
    passed, same = passed_by_others(asked), same_for_all(asked)
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
                "asked_of": sum(question.is_asked for question in column),
                "same_for_all": same[column[0].blank.id],
                "passed_by_others": _finite(passed[column[0].blank.id]),
                "why_not": next((question.why_not for question in column if question.why_not), None),
            }
            for column in zip(*asked, strict=True)
        ],
        "forms_passed_by_others": _finite(all_passed_by_others(asked)),
    }


def _marks_as_data(exercise: Exercise, found: Marks, stray: Sequence[str]) -> dict[str, Any]:
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
            for each in found.students
        ],
        "stray": list(stray),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None

"""Marks: each student's form compared with their own recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from servobench.core.errors import FormatError, NotIdentifiable, UsageError
from servobench.lab.assessment.assigned_stand import Assessment
from servobench.lab.assessment.forms import Form
from servobench.lab.assessment.questions import Question, all_blanks, questions
from servobench.lab.assessment.roster import Student
from servobench.lab.assessment.tables import csv_table
from servobench.lab.check import CheckedAnswer, check_blank
from servobench.lab.stand import MotorStand
from servobench.rig.motor.individual import same_name

Verdict: TypeAlias = Literal["right", "wrong", "missing", "not asked"]


@dataclass(frozen=True, kw_only=True)
class Mark:
    """The mark of one answer: the verdict on what was given for a blank, and the reason as a sentence.

    A blank that a student's recording doesn't tell is not asked, whatever they wrote.
    """

    blank: str
    verdict: Verdict
    given: str
    sentence: str


@dataclass(frozen=True, kw_only=True)
class StudentMarks:
    """A student's marks: a point for each right answer, out of the blanks that they were asked; `notes` are of their form."""

    student: str
    marks: tuple[Mark, ...]
    notes: tuple[str, ...] = ()

    @property
    def points(self) -> int:
        """The right answers."""
        return sum(mark.verdict == "right" for mark in self.marks)

    @property
    def total(self) -> int:
        """The blanks that they were asked."""
        return sum(mark.verdict != "not asked" for mark in self.marks)


@dataclass(frozen=True, kw_only=True)
class Marks:
    """The marks of a class, its students in the roster's order; `stray` has a sentence for each form without a student."""

    students: tuple[StudentMarks, ...]
    stray: tuple[str, ...]


def mark(
    assessment: Assessment,
    students: Sequence[Student],
    forms: Sequence[Form],
    reached: Callable[[float], object] = lambda part: None,
) -> Marks:
    """Return the marks of all; `reached` is called with the part that is done.

    A form belongs to whom its code says, or without one to the student whose folder it lies in or is called after. Raises
    `UsageError` where forms have codes and none is anybody's: then the secret or the exercise is another one.
    """
    belonging, stray = _sort_forms(assessment, students, forms)
    asked = []
    for number, student in enumerate(students):
        stand = assessment.stand(student.id)
        asked.append((stand, questions(assessment.exercise, stand)))
        reached((number + 1) / len(students))
    blanks = {blank.id for blank in all_blanks([each for _, each in asked])}
    marked = tuple(
        _mark_student(student, belonging[student.id], stand, [q for q in each if q.blank.id in blanks])
        for student, (stand, each) in zip(students, asked, strict=True)
    )
    return Marks(students=marked, stray=stray)


def marks_table(marks: Marks) -> str:
    """Return the marks as CSV: a row for each student, and for each blank the verdict, the answer and the feedback on it."""
    ids = [each.blank for each in marks.students[0].marks]
    columns = [(name, f"{name}: answer", f"{name}: feedback") for name in ids]
    head = ["student", "points", "of", *(cell for three in columns for cell in three), "notes"]
    rows = [
        [
            each.student,
            str(each.points),
            str(each.total),
            *(cell for m in each.marks for cell in (m.verdict, m.given, m.sentence)),
            " ".join(each.notes),
        ]
        for each in marks.students
    ]
    return csv_table([head, *rows])


def _sort_forms(
    assessment: Assessment, students: Sequence[Student], forms: Sequence[Form]
) -> tuple[dict[str, list[Form]], tuple[str, ...]]:
    """The forms of each student, and a sentence for each form without a student."""
    by_code = {assessment.code(student.id): student.id for student in students}
    by_place = {same_name(name): student.id for student in students for name in (student.folder, student.id)}
    belonging: dict[str, list[Form]] = {student.id: [] for student in students}
    stray = []
    for form in forms:
        places = (form.path.stem, form.path.parent.name)
        owner = by_code.get(form.code) if form.code else _first(by_place, places)
        if owner is None:
            why = f"its code {form.code[:20]!r} is nobody's" if form.code else "it has no code"
            stray.append(f"{form.path} counts for nobody: {why} in the roster")
        else:
            belonging[owner].append(form)
    coded = [form for form in forms if form.code]
    if coded and not any(form.code in by_code for form in coded):
        raise UsageError(
            f"none of the {len(coded)} forms has a code of this class in the exercise {assessment.exercise.name!r} "
            f"(the first is {coded[0].path}); they belong to another secret, exercise or class"
        )
    return belonging, tuple(stray)


def _first(by_place: dict[str, str], places: Sequence[str]) -> str | None:
    return next((by_place[same_name(place)] for place in places if same_name(place) in by_place), None)


def _mark_student(
    student: Student, forms: list[Form], stand: MotorStand, questions: list[Question]
) -> StudentMarks:
    form, notes = _choose_form(forms)
    known = {question.blank.id for question in questions}
    if form is not None:
        notes += form.notes
        others = sorted(name[:40] for name, text in form.answers.items() if name not in known and text)
        if others:
            notes += (f"Answers to questions that weren't asked: {', '.join(map(repr, others))}.",)
    return StudentMarks(
        student=student.id,
        marks=tuple(_mark(question, form, stand) for question in questions),
        notes=notes,
    )


def _choose_form(forms: list[Form]) -> tuple[Form | None, tuple[str, ...]]:
    """The form that counts; if several differ none does, because only the student knows which one was meant."""
    if not forms:
        return None, ("There is no form.",)
    if all(dict(form.answers) == dict(forms[0].answers) for form in forms):
        return forms[0], ()
    where = ", ".join(str(form.path) for form in forms)
    return None, (f"There are {len(forms)} forms with different answers: {where}. Keep one and mark again.",)


def _mark(question: Question, form: Form | None, stand: MotorStand) -> Mark:
    blank = question.blank
    answer = "" if form is None else form.answers.get(blank.id, "")
    if not question.is_answerable:
        return Mark(blank=blank.id, verdict="not asked", given=answer, sentence=question.why_not)
    if not answer.strip():
        gone = form is not None and blank.id not in form.answers
        sentence = "The form has no such line." if gone else "There is no answer."
        return Mark(blank=blank.id, verdict="missing", given="", sentence=sentence)
    checked = _check(question, answer, stand)
    return Mark(
        blank=blank.id, verdict="right" if checked.right else "wrong", given=answer, sentence=checked.sentence
    )


def _check(question: Question, answer: str, stand: MotorStand) -> CheckedAnswer:
    blank = question.blank
    try:
        return check_blank(blank, answer, stand.facts)
    except (NotIdentifiable, UsageError):
        # A known mistake may need what this stand can't tell; the right answer doesn't.
        return check_blank(blank.model_copy(update={"mistakes": ()}), answer, stand.facts)


def check_there_are_forms(forms: Sequence[Form], unread: Sequence[str], folder: object) -> None:
    """Raise `FormatError` where a folder has no form at all: then it is the wrong folder."""
    if not forms and not unread:
        raise FormatError(
            f"there is no form in {folder}; expected the answers.csv that students filled in, each in a folder or called "
            "as you like"
        )

"""Questions for a student: the blanks whose answers follow from their recording, and the distance between neighbours' answers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from servobench.core.errors import NotIdentifiable, UnknownName, UsageError
from servobench.lab.exercise import Blank, Exercise
from servobench.lab.expression import Expression
from servobench.lab.stand import MotorStand
from servobench.lab.tolerance import Tolerance


@dataclass(frozen=True, kw_only=True)
class Question:
    """A blank as one student is asked it: the right answer, and by how much one is allowed to be off, in the blank's unit.

    `why_not` says why there is no answer, in a sentence; empty where there is one.
    """

    blank: Blank
    right: float = math.nan
    allowed: float = math.nan
    why_not: str = ""

    @property
    def is_answerable(self) -> bool:
        """Whether there is a right answer."""
        return not self.why_not


def questions(exercise: Exercise, stand: MotorStand) -> tuple[Question, ...]:
    """Return what a student is asked on that stand, in the exercise's order.

    A blank that takes what the student can't have (further runs, the true parameters) is none to ask. Raises `UsageError`, with
    file and line, for a rule that asks for a fact that there isn't.
    """
    return tuple(_question(exercise, blank, stand) for blank in exercise.blanks)


def all_blanks(questions: Sequence[tuple[Question, ...]]) -> tuple[Blank, ...]:
    """Return the blanks that at least one of the students is asked, in the exercise's order."""
    return tuple(
        column[0].blank for column in zip(*questions, strict=True) if any(q.is_answerable for q in column)
    )


def pass_rates(questions: Sequence[tuple[Question, ...]]) -> Mapping[str, float]:
    """Return, by blanks, which part of the right answers of others would pass for a student's own; NaN with one student alone."""
    rates = {}
    for column in zip(*questions, strict=True):
        known = [question for question in column if question.is_answerable]
        pairs = [(mine, other) for mine in known for other in known if mine is not other]
        passed = sum(abs(other.right - mine.right) <= mine.allowed for mine, other in pairs)
        rates[column[0].blank.id] = passed / len(pairs) if pairs else math.nan
    return rates


def same_for_all(questions: Sequence[tuple[Question, ...]]) -> Mapping[str, bool]:
    """Return for each blank whether all students have the same right answer; False with a single student."""
    agreement = {}
    for column in zip(*questions, strict=True):
        right = [question.right for question in column if question.is_answerable]
        agreement[column[0].blank.id] = len(right) > 1 and all(each == right[0] for each in right)
    return agreement


def form_pass_rate(questions: Sequence[tuple[Question, ...]]) -> float:
    """Return the share of other students' whole forms that would pass as a student's own; NaN with a single student."""
    pairs = [(mine, other) for mine in questions for other in questions if mine is not other]
    passed = sum(
        all(
            abs(b.right - a.right) <= a.allowed
            for a, b in zip(mine, other, strict=True)
            if a.is_answerable and b.is_answerable
        )
        for mine, other in pairs
    )
    return passed / len(pairs) if pairs else math.nan


def _question(exercise: Exercise, blank: Blank, stand: MotorStand) -> Question:
    if blank.by_table:
        return Question(blank=blank, why_not="it is read off a study's table, which students don't get")
    try:
        known = Expression(blank.answer).evaluate(stand.facts)
    except UnknownName as error:
        raise UsageError(f"{exercise.place(blank)}: blank {blank.id!r}: {error}") from error
    except (NotIdentifiable, UsageError) as error:
        return Question(blank=blank, why_not=str(error))
    allowed = Tolerance(blank.tolerance, blank.unit).around(known)
    if not math.isfinite(allowed):
        return Question(blank=blank, why_not=f"the recording doesn't determine `{blank.answer}`")
    return Question(blank=blank, right=known.value, allowed=allowed)

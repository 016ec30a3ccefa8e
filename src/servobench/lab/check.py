"""The check of an answer: right within the tolerance, or what is wrong with it, in words that help."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from servobench.core.errors import NotIdentifiable, UnitError, UsageError
from servobench.core.rounding import SPACE, plain, round_value
from servobench.core.units import quantity
from servobench.lab.exercise import Blank, Exercise
from servobench.lab.expression import Expression, Fact
from servobench.lab.tolerance import Tolerance

_LONGEST = 100  # characters of an answer
_NEAR = 0.05  # relative; nearer than that is a slip or a rounding, no mistake of understanding
_SAME_ORDER = math.sqrt(10)  # a factor up to which the nearest power of ten to it is 10⁰
_SAME = 0.005  # relative; how near an answer has to be to a known factor to be put down to it

_SUM = re.compile(r"[-+*/^().0-9eE\s]*(?:(?:pi|π|sqrt)[-+*/^().0-9eE\s]*)*")

# The factors that students lose, each with what was likely done; the answer is the right one times the factor.
_FACTORS: tuple[tuple[float, str], ...] = (
    (60 / (2 * math.pi), "that factor is 60/2π: it looks like rpm instead of rad/s"),
    (2 * math.pi / 60, "that factor is 2π/60, which converts rpm to rad/s; it isn't needed here"),
    (180 / math.pi, "that factor is 180/π: it looks like degrees instead of radians"),
    (math.pi / 180, "that factor is π/180: it looks like radians instead of degrees"),
    (2 * math.pi, (
                      "that factor is 2π: between revolutions and radians, or hertz and rad/s, it was applied "
                      "once too often"
                  )),
    (1 / (2 * math.pi), "that factor is 1/2π: between revolutions and radians, or hertz and rad/s, it is missing"),
    (0.25, "it is a quarter of it: quadrature gives four counts for each line of the encoder's disc"),
    (4.0, "it is four times as much: the four counts for each line may have been applied twice"),
    (2.0, "it is twice as much"),
    (0.5, "it is half of it"),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CheckedAnswer:
    """Whether an answer is right, and the sentence for the student."""

    right: bool
    sentence: str


def check(
    exercise: Exercise, answers: Mapping[str, str], facts: Mapping[str, Fact]
) -> dict[str, CheckedAnswer]:
    """Return the feedback on each answer that was given, by the id of its blank.

    Raises `UnknownName` for a blank that the exercise hasn't, and `UsageError`, with the file and line of the rule, for a rule
    that asks for something that isn't among the facts.
    """
    checked = {}
    for name, text in answers.items():
        blank = exercise.blank(name)
        try:
            checked[name] = check_blank(blank, text, facts)
        except NotIdentifiable as error:
            checked[name] = CheckedAnswer(right=False, sentence=f"This answer can't be checked: {error}")
        except UsageError as error:
            raise UsageError(f"{exercise.place(blank)}: blank {blank.id!r}: {error}") from error
    return checked


def check_blank(blank: Blank, text: str, facts: Mapping[str, Fact]) -> CheckedAnswer:
    """Return the feedback on an answer to a blank.

    Raises `NotIdentifiable` where the recording behind the facts doesn't determine the right answer, and `UsageError` for a rule
    that asks for something that isn't among the facts.
    """
    answer = _number(blank, text)
    if isinstance(answer, CheckedAnswer):
        return answer
    known = Expression(blank.answer).evaluate(facts)
    allowed = Tolerance(blank.tolerance, blank.unit).around(known)
    if not math.isfinite(allowed):
        raise NotIdentifiable(
            f"the recording doesn't determine `{blank.answer}`: its interval has no end; use an experiment that "
            "determines it, or another tolerance"
        )
    if abs(answer - known.value) <= allowed:
        return CheckedAnswer(right=True, sentence=_praise(blank, known, allowed))
    sentence = _explain_mistake(blank, answer, facts)
    if not sentence:
        sentence = " ".join(filter(None, [_difference(blank, answer, known.value, allowed), blank.hint]))
    return CheckedAnswer(right=False, sentence=sentence)


def right_answer(blank: Blank, facts: Mapping[str, Fact]) -> str:
    """Return the right answer as text with its unit, and by how much it may be off; raises as `check_blank` does."""
    known = Expression(blank.answer).evaluate(facts)
    return _answer_text(blank, known, Tolerance(blank.tolerance, blank.unit).around(known))


def _number(blank: Blank, text: str) -> float | CheckedAnswer:
    """The answer in the blank's unit, or what is wrong with it as a number."""
    written = text.strip().replace("−", "-")
    if not written:
        return CheckedAnswer(right=False, sentence="There is no answer yet.")
    if len(written) > _LONGEST:
        return CheckedAnswer(right=False, sentence=f"An answer has {_LONGEST} characters at most.")
    if _SUM.fullmatch(written) and (worked_out := _evaluate(written)) is not None:
        return worked_out
    try:
        return quantity(written, blank.unit or "1")
    except UnitError as error:
        example = f' (for example "12.5 {blank.unit}")' if blank.unit else ' (for example "12.5")'
        reason = str(error).partition(", expected")[0].partition("; expected")[0]
        return CheckedAnswer(
            right=False, sentence=f"This can't be read: {reason}. Enter a number with its unit{example}."
        )


def _evaluate(written: str) -> float | None:
    """A sum of numbers and π, such as `2*pi/2048` or `5π`, in the blank's unit; None where it is none."""
    text = re.sub(r"(?<=[0-9.)])\s*(?=pi\b)", " * ", written.replace("π", "pi").replace("^", "**"))
    try:
        return Expression(text).evaluate({}).value
    except UsageError:  # it is read as a number with a unit then, which says what is wrong with it
        return None


def _answer_text(blank: Blank, known: Fact, allowed: float) -> str:
    if blank.tolerance == "exact":
        return f"{plain(known.value, 12)}{SPACE}{blank.unit}".rstrip()
    # In the blank's own unit, which a bare answer is taken to be in: no prefix is put before it.
    return f"{round_value(known.value, allowed, '')}{SPACE}{blank.unit}".rstrip()


def _praise(blank: Blank, known: Fact, allowed: float) -> str:
    within = "" if blank.tolerance == "exact" else f" Accepted: {_answer_text(blank, known, allowed)}."
    return f"Right.{within}"


def _explain_mistake(blank: Blank, answer: float, facts: Mapping[str, Fact]) -> str:
    """The exercise's explanation of this answer, where it has one."""
    for mistake in blank.mistakes:
        wrong = Expression(mistake.answer).evaluate(facts)
        allowed = Tolerance(blank.tolerance, blank.unit).around(wrong)
        if math.isfinite(allowed) and abs(answer - wrong.value) <= allowed:
            return mistake.sentence
    return ""


def _difference(blank: Blank, answer: float, known: float, allowed: float) -> str:
    """The difference between a wrong answer and the right one: its sign, a factor, its order of magnitude, or its size."""
    if known == 0:
        return f"It isn't {plain(answer)}{SPACE}{blank.unit}".rstrip() + "."
    ratio = answer / known
    if ratio == 0:
        return "It isn't zero."
    if ratio < 0 and abs(abs(answer) - abs(known)) <= allowed:
        return "The sign is wrong; the size is right."
    if blank.unit == "%" and abs(100 * ratio - 1) <= _NEAR:
        return "It looks like a fraction; in per cent it is a hundred times as much."
    # Of two numbers below zero the one that is further from it is the smaller: the size is what is spoken of.
    what = _size(abs(ratio), " in size" if known < 0 else "")
    if ratio < 0:
        return f"The sign is wrong.{' ' + what if what else ''}"
    return what or "It is close, but outside the tolerance."


def _size(ratio: float, of_what: str) -> str:
    """The error of an answer's size as its ratio to the right one; empty where it is nearly the same."""
    way = f"{'large' if ratio > 1 else 'small'}{of_what}"
    if abs(ratio - 1) <= _SAME:
        return ""
    if abs(ratio - 1) <= _NEAR:
        return f"It is close: within 5 %, a little too {way}. Check how precisely it was read or rounded."
    if math.isinf(ratio):
        return f"It is too {way} by more than any number can say."
    power = math.log10(ratio)
    if round(power) and abs(power - round(power)) < math.log10(1 + _SAME):
        return (
            f"The digits are right, but not the power of ten: it is too {way} by 10^{abs(round(power))}. Check the "
            "prefix of the unit, such as ms for s."
        )
    for factor, meaning in _FACTORS:
        if abs(ratio / factor - 1) <= _SAME:
            return f"It is too {way}: {meaning}."
    factor = max(ratio, 1 / ratio)
    if factor <= _SAME_ORDER:
        return f"It is too {way}, by more than 5 %; the order of magnitude is right."
    # One digit is enough to look for what went wrong, and too little to work the right answer out from it.
    return f"It is about {plain(float(f'{factor:.0e}'), 1)} times too {way}: the order of magnitude is wrong."

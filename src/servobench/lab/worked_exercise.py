"""An exercise worked through on a stand: what its studies found, its answers, and its corrections with their figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.rounding import SPACE, plain, with_unit
from servobench.lab.check import CheckedAnswer, check, right_answer
from servobench.lab.course import course_of
from servobench.lab.exercise import Blank, Correction, Exercise
from servobench.lab.expression import Expression
from servobench.lab.stand import MotorStand
from servobench.lab.studies.base import StudyResult
from servobench.lab.tolerance import Tolerance
from servobench.report.illustrations import Illustration


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The right answer to a blank as text, with how far one may be off; `why_not` says why there is none, and `text` is empty."""

    blank: Blank
    text: str = ""
    why_not: str = ""


@dataclass(frozen=True, kw_only=True)
class EvaluatedCorrection:
    """A correction with our figure worked out: `ours` is the sentence, `value` the figure in the correction's unit, or None."""

    correction: Correction
    ours: str
    value: float | None
    studies: tuple[str, ...] = ()
    """The studies in the text that the figure comes from."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkedExercise:
    """An exercise and its stand; everything is computed on first use.

    `given` are somebody's answers by the ids of blanks.
    """

    exercise: Exercise
    stand: MotorStand
    given: Mapping[str, str]

    def study_result(self, name: str) -> StudyResult:
        """Return what a study found; where the stand can't tell it, that is the only sentence.

        The names of its figures are its own, so that no two on a page are alike. Raises `UsageError` as the stand does.
        """
        try:
            result = self.stand.study_result(name)
        except NotIdentifiable as error:
            return StudyResult(sentences=(f"Nothing can be shown here: {str(error).rstrip('.')}.",))
        figures = tuple(replace(figure, name=f"{name}-{figure.name}") for figure in result.figures)
        return replace(result, figures=figures)

    @property
    def in_short(self) -> tuple[str, ...]:
        """The exercise's means: the device and its counter, duration and sample time, and the chain."""
        experiment, info = self.stand.experiment, self.stand.info
        counts = info.channel("counts")
        counter = f"a counter of {counts.counter_bits} bits" if counts and counts.counter_bits else ""
        chain = f"the speed through ‘{experiment.chain}’" if experiment.chain not in ("", "none") else ""
        rate = f"{with_unit(experiment.duration or 0.0, 's')} at {with_unit(experiment.sample_rate, 'Hz')}"
        return tuple(filter(None, (f"device: {info.name}", counter, rate, chain)))

    @property
    def cut_short(self) -> str:
        """The reason why the exercise's run ended early, as a sentence; empty where it didn't."""
        stopped = self.stand.recording.stopped
        return "" if stopped.reason == "finished" else stopped.sentence

    @cached_property
    def limited(self) -> str:
        """In an open loop, that the motor got less voltage than the exercise asks for, as a sentence; empty where it got that."""
        recording = self.stand.recording
        names = ("commanded", "applied", "saturated")
        if not self._is_open_loop or any(name not in recording for name in names):
            return ""
        commanded, applied = (np.abs(recording[name].values) for name in names[:2])
        held = recording["saturated"].values > 0
        if not held.any():
            return ""
        return (
            f"the commanded voltage reaches {with_unit(float(commanded[held].max()), 'V')}, and the motor got at "
            f"most {with_unit(float(applied[held].max()), 'V')}; use a smaller signal, or check limits.voltage"
        )

    @property
    def _is_open_loop(self) -> bool:
        controller = self.exercise.experiment.controller
        return controller is None or controller.reference_unit == "V"

    @cached_property
    def unnoticed_mistakes(self) -> tuple[str, ...]:
        """A sentence for each known mistake within the tolerance of the right answer: students who make it wouldn't learn of
        it.

        Raises `UsageError`, with file and line, for a mistake that can't be worked out.
        """
        sentences = []
        for blank in self.exercise.blanks:
            for mistake in blank.mistakes:
                try:
                    wrong = Expression(mistake.answer).evaluate(self.stand.facts).value
                    right = Expression(blank.answer).evaluate(self.stand.facts)
                except NotIdentifiable:
                    continue  # here it can't be distinguished; in another recording it may be
                except UsageError as error:
                    place = self.exercise.place(blank)
                    raise UsageError(f"{place}: blank {blank.id!r}, a mistake: {error}") from error
                allowed = Tolerance(blank.tolerance, blank.unit).around(right)
                if math.isfinite(allowed) and abs(wrong - right.value) <= allowed:
                    sentences.append(
                        f"{blank.id}: the mistake `{mistake.answer}` is within the tolerance of the right answer, so "
                        "its sentence isn't shown"
                    )
        return tuple(sentences)

    @cached_property
    def course(self) -> Illustration | None:
        """The figure of the exercise's own run."""
        return course_of(self.stand.recording, self.exercise.experiment.chain)

    @cached_property
    def checked(self) -> Mapping[str, CheckedAnswer]:
        """The checked answers by blank; raises `UnknownName` for a blank that isn't there."""
        return check(self.exercise, self.given, self.stand.facts)

    @cached_property
    def answers(self) -> tuple[Answer, ...]:
        """The right answers; raises `UsageError`, with file and line, for a rule that can't be worked out."""
        return tuple(self._answer(blank) for blank in self.exercise.blanks)

    @cached_property
    def corrections(self) -> tuple[EvaluatedCorrection, ...]:
        """The corrections; raises `UsageError`, with file and line, for one whose figure can't be worked out."""
        return tuple(self._evaluate(each) for each in self.exercise.corrections)

    def _answer(self, blank: Blank) -> Answer:
        try:
            return Answer(blank=blank, text=right_answer(blank, self.stand.facts))
        except NotIdentifiable as error:
            return Answer(blank=blank, why_not=str(error))
        except UsageError as error:
            raise UsageError(f"{self.exercise.place(blank)}: blank {blank.id!r}: {error}") from error

    def _evaluate(self, correction: Correction) -> EvaluatedCorrection:
        if not correction.answer:
            return EvaluatedCorrection(correction=correction, ours=correction.ours, value=None)
        try:
            known = Expression(correction.answer).evaluate(self.stand.facts)
            value = known.value
            if known.half and known.half >= abs(value):
                raise NotIdentifiable(
                    f"its 95 % interval is ±{plain(known.half, 2)}{SPACE}{correction.unit}".rstrip()
                )
        except NotIdentifiable as error:
            text = correction.ours.replace("{}", "a figure that can't be determined here")
            return EvaluatedCorrection(correction=correction, ours=f"{text.rstrip('.')}: {error}", value=None)
        except UsageError as error:
            place = self.exercise.place_of_correction(correction)
            raise UsageError(f"{place}: the correction of {correction.where!r}: {error}") from error
        figure = f"{plain(value, correction.digits)}{SPACE}{correction.unit}".rstrip()
        names = dict.fromkeys(name.partition("_")[0] for name in Expression(correction.answer).names)
        return EvaluatedCorrection(
            correction=correction,
            ours=correction.ours.replace("{}", figure),
            value=value,
            studies=tuple(
                piece.study for piece in self.exercise.pieces if piece.study and piece.study in names
            ),
        )

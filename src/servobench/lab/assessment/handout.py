"""The handout for students: a folder each with their recording, the exercise's page without answers, and a form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from servobench.core.errors import StorageError, UsageError
from servobench.lab.assessment import forms
from servobench.lab.assessment.assigned_stand import Assessment
from servobench.lab.assessment.questions import Question, all_blanks, questions
from servobench.lab.assessment.roster import Student
from servobench.lab.exercise import Blank, Exercise
from servobench.lab.stand import stand_of
from servobench.rig.experiment.experiment import DeviceChoice

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Handout:
    """A student's handout: their folder, what they are asked, and why the run was `cut_short`, or empty."""

    student: Student
    asked: tuple[Question, ...]
    cut_short: str


def hand_out(
    assessment: Assessment,
    students: Sequence[Student],
    folder: Path,
    reached: Callable[[float], object] = lambda part: None,
) -> tuple[Handout, ...]:
    """Write a folder for each student, and return what is in them; `reached` is called with the part that is done.

    Everybody gets the same blanks, those that anybody's recording tells. Raises `UsageError` where there is none, before anything
    is written, and `StorageError` where a file can't be written.
    """
    if folder.resolve() in assessment.secret_file.resolve().parents:
        raise UsageError(
            f"the secret {assessment.secret_file} is in {folder}, which is handed out; put it elsewhere"
        )
    made = []
    for number, student in enumerate(students):
        stand = assessment.stand(student.id)
        made.append((student, stand.recording, questions(assessment.exercise, stand)))
        reached((number + 1) / (2 * len(students)))
    blanks = all_blanks([asked for _, _, asked in made])
    if not blanks:
        reasons: dict[str, list[str]] = {}
        for question in made[0][2]:
            reasons.setdefault(question.why_not, []).append(question.blank.id)
        why = "; ".join(f"{', '.join(ids)}: {reason}" for reason, ids in reasons.items())
        more = (
            ""
            if assessment.with_motor
            else ", or `with_motor=...` where the students have their motors in panels"
        )
        raise UsageError(
            f"{assessment.exercise.source}: none of its blanks can be answered from what students get ({why}); use "
            f"another exercise{more}"
        )
    handouts = []
    for number, (student, recording, asked) in enumerate(made):
        _write(assessment, student, recording, blanks, folder / student.folder)
        stopped = recording.stopped
        cut_short = "" if stopped.reason == "finished" else stopped.sentence
        handouts.append(Handout(student=student, asked=asked, cut_short=cut_short))
        reached((len(students) + number + 1) / (2 * len(students)))
    return tuple(handouts)


def for_students(exercise: Exercise, blanks: Sequence[Blank]) -> Exercise:
    """Return an exercise as students read it: without studies and corrections, which tell answers, or the twin's settings."""
    text = "\n".join(piece.text.strip("\n") for piece in exercise.pieces if not piece.study)
    return replace(
        exercise,
        text=f"{text}\n",
        blanks=tuple(blanks),
        lines=tuple(exercise.lines[exercise.blanks.index(blank)] for blank in blanks),
        studies={},
        study_lines={},
        corrections=(),
        correction_lines=(),
        experiment=exercise.experiment.model_copy(update={"device": DeviceChoice(), "seed": 0}),
    )


def _write(
    assessment: Assessment, student: Student, recording: Recording, blanks: Sequence[Blank], folder: Path
) -> None:
    from servobench.lab.page import write_exercise
    from servobench.lab.worked_exercise import WorkedExercise
    from servobench.recordings.formats.base import save

    read = for_students(assessment.exercise, blanks)
    name = assessment.exercise.name
    try:
        folder.mkdir(parents=True)
        form = forms.blank_form(blanks, assessment.code(student.id))
        (folder / forms.NAME).write_text(form, encoding="utf-8", newline="")
    except OSError as error:
        raise StorageError(f"{folder} can't be written: {error.strerror or error}") from error
    save(recording, folder / f"{name}.mcap")
    save(recording, folder / f"{name}.csv")
    worked = WorkedExercise(exercise=read, stand=stand_of(read, recording), given={})
    write_exercise(worked, folder / f"{name}.html", solution=False, form=forms.NAME)

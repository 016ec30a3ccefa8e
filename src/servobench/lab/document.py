"""The output of exercises as plain data, for other programs: `servobench.lab/1`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from servobench.core.json_numbers import finite
from servobench.lab.expression import Fact
from servobench.lab.studies.base import Column, StudyResult
from servobench.lab.worked_exercise import EvaluatedCorrection, WorkedExercise

SCHEMA = "servobench.lab/1"


def to_dict(lab: Sequence[WorkedExercise], *, solution: bool) -> dict[str, Any]:
    """Return worked exercises as plain data; with `solution` including the right answers."""
    plain: dict[str, Any] = finite(
        {"schema": SCHEMA, "exercises": [_exercise(worked, solution=solution) for worked in lab]}
    )
    return plain


def _exercise(worked: WorkedExercise, *, solution: bool) -> dict[str, Any]:
    exercise = worked.exercise
    return {
        "name": exercise.name,
        "title": exercise.title,
        "sentence": exercise.sentence,
        "order": exercise.order,
        "device": worked.stand.info.name,
        "blanks": [_blank(worked, number, solution=solution) for number in range(len(exercise.blanks))],
        "studies": {name: _study(worked.study_result(name)) for name in exercise.studies},
        "corrections": [_correction(each) for each in worked.corrections],
    }


def _blank(worked: WorkedExercise, number: int, *, solution: bool) -> dict[str, Any]:
    blank = worked.exercise.blanks[number]
    checked = worked.checked.get(blank.id)
    return {
        "id": blank.id,
        "label": blank.label,
        "unit": blank.unit,
        "right_answer": (worked.answers[number].text or None) if solution else None,
        "given": worked.given.get(blank.id),
        "right": None if checked is None else checked.right,
        "sentence": None if checked is None else checked.sentence,
    }


def _study(shown: StudyResult) -> dict[str, Any]:
    return {
        "tables": [
            {"title": table.title, "note": table.note, "columns": [_column(each) for each in table.columns]}
            for table in shown.tables
        ],
        "figures": [
            {"name": figure.name, "title": figure.title, "description": figure.description}
            for figure in shown.figures
        ],
        "sentences": list(shown.sentences),
        "facts": {name: _fact(fact) for name, fact in shown.facts.items()},
    }


def _column(column: Column) -> dict[str, Any]:
    return {
        "name": column.name,
        "heading": column.heading,
        "unit": column.unit,
        "values": list(column.values),
        "paper": list(column.paper),
    }


def _fact(fact: Fact) -> dict[str, float | None]:
    return {"value": fact.value, "half": fact.half}


def _correction(each: EvaluatedCorrection) -> dict[str, Any]:
    return {
        "where": each.correction.where,
        "paper": each.correction.paper,
        "ours": each.ours,
        "value": each.value,
        "unit": each.correction.unit,
        "why": each.correction.why,
    }

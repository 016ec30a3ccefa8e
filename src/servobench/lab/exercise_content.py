"""The contents of an exercise, ready to show: tables as texts and figures as drawings, in plain data."""

from __future__ import annotations

from typing import Any

from servobench.lab.formula import line_text
from servobench.lab.studies.base import StudyResult
from servobench.lab.table_text import text_columns
from servobench.lab.worked_exercise import WorkedExercise
from servobench.report.html import NARROW
from servobench.report.illustrations import Illustration
from servobench.report.svg import inline_svg


def results(worked: WorkedExercise) -> dict[str, Any]:
    """Return what the studies that stand in the text found, and the corrections, as plain data.

    A figure is an `<svg>` element whose colours are variables of the page, such as `var(--ink)`.
    """
    return {
        "studies": {
            piece.study: _study(worked.study_result(piece.study))
            for piece in worked.exercise.pieces
            if piece.study
        },
        "corrections": [
            {
                "where": line_text(each.correction.where),
                "paper": line_text(each.correction.paper),
                "ours": line_text(each.ours),
                "why": line_text(each.correction.why),
            }
            for each in worked.corrections
        ],
    }


def _study(shown: StudyResult) -> dict[str, Any]:
    return {
        "tables": [
            {
                "title": line_text(table.title),
                "note": line_text(table.note),
                "columns": [
                    {
                        "heading": line_text(column.titled),
                        "kind": column.kind,
                        "texts": list(map(line_text, column.texts)),
                    }
                    for column in text_columns(table)
                ],
            }
            for table in shown.tables
        ],
        "figures": [_figure(figure) for figure in shown.figures],
        "sentences": list(map(line_text, shown.sentences)),
    }


def _figure(figure: Illustration) -> dict[str, str]:
    return {
        "title": line_text(figure.title),
        "caption": line_text(figure.caption),
        "description": figure.description,
        "svg": inline_svg(
            figure.draw(NARROW), name=figure.name, title=figure.title, description=figure.description
        ),
    }

"""The page of a report: its templates filled, and every user text escaped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from servobench.core.finding import Severity, Verdict
from servobench.identification.result import Result
from servobench.recordings.recording import Recording
from servobench.report import (
    events,
    history,
    illustrations,
    model_illustrations,
    safety,
    summary,
    tables,
    timing,
)
from servobench.report.illustrations import Illustration
from servobench.report.mathml import transfer_function_math
from servobench.report.palette import Style
from servobench.report.svg import PLACEHOLDERS, inline_svg

if TYPE_CHECKING:
    from jinja2 import Environment, Template

WIDE = Style(width=720.0, palette=PLACEHOLDERS)
NARROW = Style(width=344.0, palette=PLACEHOLDERS)

VERDICTS = {Verdict.TRUSTED: "Trusted", Verdict.DOUBTFUL: "Doubtful", Verdict.REFUSED: "Refused"}
SEVERITIES = {
    Severity.DANGER: "Danger",
    Severity.REFUSAL: "Refusal",
    Severity.WARNING: "Warning",
    Severity.INFO: "Information",
}


@dataclass(frozen=True, kw_only=True)
class DrawnFigure:
    """A figure on the page: its name for links, title and caption, and its drawings, wide and narrow, which are our markup.

    `wide` is empty for a figure that stands beside another one and is narrow on every page.
    """

    name: str
    title: str
    caption: str
    wide: str
    narrow: str


def page(result: Result, recordings: Sequence[Recording], command: str) -> str:
    """Return the whole page as a text."""
    return template("page.html.j2").render(
        style=source("style.css"),
        fit=result.fit,
        system=result.transfer_function,
        validation=result.validation,
        provenance=result.provenance,
        command=command or history.command(recordings),
        sentence=summary.sentence,
        capital=tables.capital,
        explained=summary.fit_text,
        **_head(result, recordings),
        **_history(result, recordings),
        **_tables(result),
        **_figures(result),
        **_timing(recordings),
    )


def _head(result: Result, recordings: Sequence[Recording]) -> dict[str, Any]:
    """The title, the verdict, the answer and the findings."""
    return {
        "title": summary.title(result, recordings),
        "verdict": str(result.verdict),
        "verdict_word": VERDICTS[result.verdict],
        "reason": summary.reason(result),
        "answer": summary.answer(result),
        "dangers": [each for each in result.findings if each.severity is Severity.DANGER],
        "findings": tables.finding_groups(result.findings),
        "foremost": tables.foremost(result.findings),
        "severity_words": {str(severity): word for severity, word in SEVERITIES.items()},
    }


def _history(result: Result, recordings: Sequence[Recording]) -> dict[str, Any]:
    """The experiment, its course, and its recording."""
    runs = [history.run_history(recording) for recording in recordings]
    runs = runs or [history.dataset_history(data) for data in result.data]
    return {
        "asked": [
            (recording, history.experiment_facts(recording)) for recording in _by_experiment(recordings)
        ],
        "happened": runs,
        "side_by_side": history.side_by_side(runs),
        "guarded_by": [
            (recording.name, rows) for recording in recordings if (rows := safety.guard_rows(recording))
        ],
        "events": [
            event_table
            for recording in recordings
            if (event_table := events.events_of(recording)) is not None
        ],
        "made_on": history.origin_facts(recordings),
    }


def _tables(result: Result) -> dict[str, Any]:
    """The model in symbols and numbers, and what else stands in tables."""
    fit, data = result.fit, result.data
    return {
        "math": transfer_function_math(result),
        "lost": summary.loss_text(fit) if fit else "",
        "parameters": tables.parameter_rows(result),
        "budget": tables.budget_rows(result),
        "good_for": result.good_for,
        "motor": tables.motor_rows(result),
        "nominal": tables.comparison_rows(result.nominal),
        "operating_range": tables.operating_range(result.operating_range, data[0]) if data else (),
        "made_with": tables.provenance(result),
    }


def _figures(result: Result) -> dict[str, Any]:
    """All figures, drawn."""
    data = {
        "course": single(illustrations.data_and_model(result)) if result.data else None,
        "nominal_figure": single(illustrations.against_nominal(result.nominal)),
    }
    fit = result.fit
    if fit is None:
        return data
    return data | {
        "residuals": [_row(row) for row in illustrations.residuals(fit)],
        "bode": single(model_illustrations.frequency_response(fit, result.derived)),
        "responses": _row(
            (
                model_illustrations.step_response(fit, result.derived),
                model_illustrations.poles(fit, result.derived),
            )
        ),
    }


def _timing(recordings: Sequence[Recording]) -> dict[str, Any]:
    """The lateness of the samples, where time passed."""
    runs = timing.latenesses(recordings)
    figures = timing.timing_figures(runs)
    return {"timing": timing.timing_facts(runs), "timing_figures": _row(figures) if figures else []}


def single(illustration: Illustration | None) -> DrawnFigure | None:
    """Return a figure as wide as the page, drawn a second time for narrow screens; None for none."""
    if illustration is None:
        return None
    return _draw(illustration, _svg(illustration, WIDE, "wide"))


def _row(row: Sequence[Illustration]) -> list[DrawnFigure]:
    """Figures side by side, or a single one."""
    if len(row) == 1:
        return [_draw(row[0], _svg(row[0], WIDE, "wide"))]
    return [_draw(illustration, "") for illustration in row]


def _draw(illustration: Illustration, wide: str) -> DrawnFigure:
    from markupsafe import Markup

    return DrawnFigure(
        name=illustration.name,
        title=illustration.title,
        caption=illustration.caption,
        wide=Markup(wide),
        narrow=Markup(_svg(illustration, NARROW, "narrow")),
    )


def _svg(illustration: Illustration, style: Style, variant: str) -> str:
    return inline_svg(
        illustration.draw(style),
        name=f"{illustration.name}-{variant}",
        title=illustration.title,
        description=illustration.description,
    )


def _by_experiment(recordings: Sequence[Recording]) -> list[Recording]:
    """The first recording of each different experiment; none for imported files."""
    first: dict[str, Recording] = {}
    for recording in recordings:
        if recording.experiment:
            first.setdefault(recording.experiment, recording)
    return list(first.values())


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    from servobench.report.template_cache import TemplateCache

    return Environment(
        loader=FunctionLoader(source),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=TemplateCache(),
    )


def template(name: str) -> Template:
    """Return a template of this folder."""
    return _environment().get_template(name)


def source(name: str) -> str:
    """Return the text of a file of this folder; also out of a zipped package."""
    from importlib.resources import files

    return files("servobench.report").joinpath(name).read_text(encoding="utf-8")

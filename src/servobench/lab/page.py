"""Exercises as pages for people to read: one of an exercise, or a folder with all of them, what they correct, and a way in.

Each page is one file that needs no network and runs nothing; the pages of a folder lead to each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from servobench._version import __version__
from servobench.core.errors import StorageError
from servobench.lab.exercise import Exercise
from servobench.lab.formula import line_html
from servobench.lab.markdown import to_html
from servobench.lab.paper_items import PaperItem
from servobench.lab.studies.base import StudyResult
from servobench.lab.table_text import OFF, PAPER, TextColumn, text_columns
from servobench.lab.worked_exercise import WorkedExercise
from servobench.report import summary
from servobench.report.document import write_page
from servobench.report.html import DrawnFigure, single, source, template
from servobench.report.tables import capital

INDEX, PAPERS = "index.html", "paper.html"
_MOST_BESIDE = 7  # columns that the width of the text has room for
_WIDEST = 62  # characters side by side that it has room for, with the gaps between the columns
_GAP = 2  # characters between two columns


@dataclass(frozen=True, kw_only=True)
class Neighbours:
    """An exercise's place in its folder: its number, how many of them there are, and those before and after."""

    number: int
    of: int
    before: Exercise | None
    after: Exercise | None


@dataclass(frozen=True, kw_only=True)
class Block:
    """A block of an exercise's text: HTML of its Markdown, or a study's result.

    Of a study: its tables, each a title, the columns as texts and a note; its sentences; what of the paper it is about; drawings.
    """

    html: str = ""
    study: str = ""
    tables: tuple[tuple[str, tuple[TextColumn, ...], str], ...] = ()
    sentences: tuple[str, ...] = ()
    paper: tuple[PaperItem, ...] = ()
    drawings: tuple[DrawnFigure, ...] = ()

    @property
    def is_broad(self) -> bool:
        """Whether a table in it has so many columns, or so wide ones, that it may be wider than the text."""
        return any(_is_broad(columns) for _, columns, _ in self.tables)


@dataclass(frozen=True, kw_only=True)
class Beside:
    """A number of the paper beside ours, as texts, and the exercise and its table that it stands in.

    `what` says which row of the table, `off` by how much ours differs.
    """

    exercise: Exercise
    table: str
    what: str
    ours: str
    paper: str
    off: str


class InPart(KeyboardInterrupt):
    """The pages of a folder were interrupted: so many are done, of so many."""

    def __init__(self, folder: Path, done: int, of: int) -> None:
        super().__init__(folder, done, of)
        self.folder = folder
        self.done = done
        self.of = of


def exercise_page(
    worked: WorkedExercise,
    *,
    solution: bool,
    studies: bool = False,
    neighbours: Neighbours | None = None,
    form: str = "",
) -> str:
    """Return the page of an exercise; with `solution` the right answers stand in the blanks.

    What its studies found and where the paper errs is folded up, as it tells most answers; with `studies` or `solution` it is
    open. `form` is the name of the file that answers are to be written into, where they are marked later.
    """
    exercise = worked.exercise
    answers = worked.answers if solution else ()
    return _page(
        "lab_exercise.html.j2",
        title=exercise.title,
        exercise=exercise,
        blocks=_blocks(worked),
        opened=studies or solution,
        course=single(worked.course),
        cut_short=worked.cut_short,
        chips=worked.in_short,
        toml=worked.stand.experiment.to_toml(),
        answers={answer.blank.id: answer for answer in answers},
        given=worked.given,
        checked=worked.checked,
        corrections=worked.corrections,
        neighbours=neighbours,
        form=form,
    )


def write_exercise(
    worked: WorkedExercise, path: Path, *, solution: bool, studies: bool = False, form: str = ""
) -> None:
    """Write the page of an exercise to a file; raises `StorageError`, which says why it can't be."""
    write_page(exercise_page(worked, solution=solution, studies=studies, form=form), path)


def write_lab(
    folder: Path,
    lab: Sequence[WorkedExercise],
    *,
    solution: bool,
    studies: bool = False,
    begun: Callable[[int, WorkedExercise], object],
) -> None:
    """Write the pages of all exercises, of what they correct, and the way in; `begun` is told of each exercise before its page.

    Whoever interrupts it finds a way in to the exercises that are done, which says what is missing, and is told by `InPart`.
    Raises `StorageError`, which says why one can't be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"{folder} can't be written: {error.strerror or error}") from error

    def page(worked: WorkedExercise, neighbours: Neighbours) -> str:
        return exercise_page(worked, solution=solution, studies=studies, neighbours=neighbours)

    done = 0
    try:
        for number, worked in enumerate(lab):
            begun(number, worked)
            text = page(worked, _neighbours(lab, number))
            done = number + 1  # if its file is interrupted it is written below
            write_page(text, folder / page_of(worked.exercise))
        _write_ways_in(folder, lab)
    except KeyboardInterrupt as interrupt:
        if done:
            last = lab[done - 1]
            alone = replace(_neighbours(lab, done - 1), after=None)  # the next one isn't there
            write_page(page(last, alone), folder / page_of(last.exercise))
            _write_ways_in(folder, lab[:done], missing=lab[done:])
        raise InPart(folder, done, len(lab)) from interrupt


def _write_ways_in(
    folder: Path, lab: Sequence[WorkedExercise], missing: Sequence[WorkedExercise] = ()
) -> None:
    write_page(papers_page(lab, missing), folder / PAPERS)
    write_page(index_page(lab, missing), folder / INDEX)


def index_page(lab: Sequence[WorkedExercise], missing: Sequence[WorkedExercise] = ()) -> str:
    """Return the way in: all exercises in their order, the missing ones without a link, and what leads to corrections."""
    return _page(
        "lab_index.html.j2", title="The laboratory", lab=lab, missing=missing, numbers=len(_beside(lab))
    )


def papers_page(lab: Sequence[WorkedExercise], missing: Sequence[WorkedExercise] = ()) -> str:
    """Return the page on the paper: what it contains and where that is here, what is corrected, and its numbers beside ours.

    What is `missing` is named, as its part of all that isn't there.
    """
    return _page(
        "lab_paper.html.j2",
        title="The paper’s figures and ours",
        lab=lab,
        missing=missing,
        contained=_contents(lab),
        beside=_beside(lab),
    )


def page_of(exercise: Exercise) -> str:
    """Return the name of an exercise's page in the folder of all."""
    return f"{exercise.name}.html"


def _page(name: str, **known: Any) -> str:
    text = template(name).render(
        style=f"{source('style.css')}\n{source('lab.css')}",
        version=__version__,
        sentence=summary.sentence,
        capital=capital,
        line=line_html,
        page_of=page_of,
        index=INDEX,
        papers=PAPERS,
        **known,
    )
    return text.encode("utf-8", "replace").decode("utf-8")


def _blocks(worked: WorkedExercise) -> tuple[Block, ...]:
    return tuple(
        _study(piece.study, worked.study_result(piece.study), worked.exercise.shows(piece.study))
        if piece.study
        else _text(piece.text)
        for piece in worked.exercise.pieces
    )


def _is_broad(columns: Sequence[TextColumn]) -> bool:
    columns_shown = [column for column in columns if column.kind != "off"]
    width = sum(_least_width(column) + _GAP for column in columns_shown)
    return len(columns_shown) > _MOST_BESIDE or width > _WIDEST


def _least_width(column: TextColumn) -> int:
    """The least width of a column in characters: words are wrapped, numbers aren't."""
    wrapped = [column.heading, *(column.texts if column.kind == "word" else ())]
    words = [word for text in wrapped for word in text.split()]
    return max(map(len, [*words, column.unit, *(() if column.kind == "word" else column.texts)]), default=0)


def _text(text: str) -> Block:
    from markupsafe import Markup

    # The page's own title is its only heading of the first level; a tag of the writer's comes out as text.
    html = to_html(text).replace("<h1>", "<h2>").replace("</h1>", "</h2>")
    return Block(html=Markup(html))


def _study(name: str, shown: StudyResult, paper: tuple[PaperItem, ...]) -> Block:
    return Block(
        study=name,
        paper=paper,
        tables=tuple((table.title, text_columns(table), table.note) for table in shown.tables),
        sentences=shown.sentences,
        drawings=tuple(drawing for figure in shown.figures if (drawing := single(figure))),
    )


def _neighbours(lab: Sequence[WorkedExercise], number: int) -> Neighbours:
    return Neighbours(
        number=number + 1,
        of=len(lab),
        before=lab[number - 1].exercise if number else None,
        after=lab[number + 1].exercise if number + 1 < len(lab) else None,
    )


def _contents(lab: Sequence[WorkedExercise]) -> list[tuple[PaperItem, Exercise]]:
    """The paper's items with the exercises that repeat them, by the paper's parts and then in the exercises' order."""
    entries = [(item, worked.exercise) for worked in lab for item in worked.exercise.paper]
    return sorted(entries, key=lambda each: each[0].part)


def _beside(lab: Sequence[WorkedExercise]) -> tuple[Beside, ...]:
    """Each number of the paper that a table of an exercise has, in the order of the exercises."""
    return tuple(
        comparison
        for worked in lab
        for piece in worked.exercise.pieces
        if piece.study
        for table in worked.study_result(piece.study).tables
        for comparison in _in_table(worked.exercise, table.title, text_columns(table))
    )


def _in_table(exercise: Exercise, title: str, columns: Sequence[TextColumn]) -> list[Beside]:
    """The paper's numbers in a table; a row is called by its words or, without any, by its first number."""
    rows = range(len(columns[0].texts)) if columns else ()
    units = next((column.texts for column in columns if column.heading == "unit"), None)
    comparisons = []
    for ours, paper, off in zip(columns, columns[1:], [*columns[2:], None], strict=False):
        if paper.heading != PAPER:
            continue
        for row in rows:
            if not paper.texts[row]:
                continue
            unit = ours.unit or (units[row] if units else "")
            named = "" if columns[0] is ours else f"{columns[0].texts[row]} {columns[0].unit}".strip()
            heading = "" if units else ours.heading
            comparisons.append(
                Beside(
                    exercise=exercise,
                    table=title,
                    what=": ".join(filter(None, (named, heading))),
                    ours=f"{ours.texts[row]} {unit}".rstrip(),
                    paper=paper.texts[row],
                    off=off.texts[row] if off is not None and off.heading == OFF else "",
                )
            )
    return comparisons

"""An exercise in words and figures, for a terminal or a text file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import Heading, Markdown
from rich.segment import Segment, Segments
from rich.text import Text

from servobench.cli.layout import show_table, show_wrapped
from servobench.cli.terminal import printable
from servobench.lab.formula import line_text

if TYPE_CHECKING:
    from servobench.lab.paper_items import PaperItem
    from servobench.lab.studies.base import StudyResult
    from servobench.lab.worked_exercise import WorkedExercise


def show_worked(console: Console, worked: WorkedExercise, *, solution: bool, studies: bool) -> None:
    """Print an exercise: its text and its blanks; with `studies` what its studies found, where they stand, and what it corrects.

    With `solution` the right answers are shown next to the blanks, and the studies, too.
    """
    opened = solution or studies
    exercise = worked.exercise
    show_wrapped(console, Text(), line_text(exercise.title), hanging=0)
    if exercise.sentence:
        show_wrapped(console, Text(), line_text(exercise.sentence), hanging=0)
    show_wrapped(console, Text(), "; ".join(worked.in_short), hanging=0)
    for piece in exercise.pieces:
        console.print()
        if piece.study and opened:
            _show_items(console, exercise.shows(piece.study))
            _show_study(console, worked.study_result(piece.study))
        elif piece.study:
            console.print(
                Text("(--studies shows the results)", style="dim"),
                soft_wrap=True,
            )
        else:
            show_markdown(console, piece.text)
    console.print()
    _show_cut_short(console, worked)
    if solution and worked.limited:
        show_wrapped(console, Text("! ", style="bold yellow"), worked.limited, hanging=2)
        console.print()
    _show_blanks(console, worked, solution=solution)
    if opened and worked.corrections:
        console.print()
        _show_corrections(console, worked)


def _show_cut_short(console: Console, worked: WorkedExercise) -> None:
    """Print why the run ended before its time, and nothing where it didn't."""
    if worked.cut_short:
        head = Text.assemble(("! ", "bold yellow"), "the run ended early: ")
        show_wrapped(console, head, worked.cut_short, hanging=2)
        console.print()


def show_checked(console: Console, worked: WorkedExercise) -> None:
    """Print what is to be said of the answers that were given, and first, if so, that the run didn't last."""
    _show_cut_short(console, worked)
    for name, checked in worked.checked.items():
        symbol, style = ("✓", "bold green") if checked.right else ("✗", "bold red")
        head = Text.assemble("  ", (symbol, style), f" {name} = {printable(worked.given[name])}: ")
        show_wrapped(console, head, line_text(checked.sentence), hanging=4)


def show_markdown(console: Console, text: str) -> None:
    """Print Markdown; no line ends with blanks."""
    for line in console.render_lines(_Plain(printable(text).strip()), pad=False):
        console.print(Segments([*_without_blanks_at_the_end(line), Segment.line()]), end="", soft_wrap=True)


class _FlushHeading(Heading):
    """A heading as bold words at the left."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        self.text.justify = "left"
        self.text.stylize("bold")
        yield self.text


class _Plain(Markdown):
    elements: ClassVar = {**Markdown.elements, "heading_open": _FlushHeading}

    def __init__(self, markup: str) -> None:
        from servobench.lab.markdown import as_text

        super().__init__(markup)
        self.parsed = as_text(markup)  # rich knows of no formulas


def _without_blanks_at_the_end(line: Iterable[Segment]) -> list[Segment]:
    segments = list(line)
    while segments and not segments[-1].text.strip():
        segments.pop()
    if segments:
        last = segments[-1]
        segments[-1] = Segment(last.text.rstrip(), last.style, last.control)
    return segments


def _show_items(console: Console, items: Sequence[PaperItem]) -> None:
    if items:
        text = "; ".join(f"{each.part}, {each.item}" for each in items)
        show_wrapped(console, Text("in the paper: ", style="dim"), line_text(text), hanging=2)


def _show_study(console: Console, shown: StudyResult) -> None:
    from servobench.lab.table_text import text_columns

    for number, table in enumerate(shown.tables):
        if number:
            console.print()
        if table.title:
            console.print(Text(printable(line_text(table.title)), style="bold"), soft_wrap=True)
        columns = text_columns(table)
        headings = [line_text(column.titled) for column in columns]
        # A column that ends with words is wrapped; one of numbers at the end is written out.
        rows = list(zip(*(column.texts for column in columns), strict=True))
        right = [heading for heading, column in zip(headings, columns, strict=True) if column.kind != "word"]
        plain = [[line_text(text).replace("−", "-") for text in row] for row in rows]
        show_table(console, headings, plain, right=right)
        if table.note:
            show_wrapped(console, Text("  "), line_text(table.note), hanging=2)
    for figure in shown.figures:
        head = Text.assemble(("Figure: ", "dim"), printable(line_text(figure.title)), ". ")
        show_wrapped(console, head, line_text(figure.description), hanging=2)
    for sentence in shown.sentences:
        show_wrapped(console, Text(), line_text(sentence), hanging=0)


def _show_blanks(console: Console, worked: WorkedExercise, *, solution: bool) -> None:
    exercise = worked.exercise
    answers = {answer.blank.id: answer for answer in worked.answers} if solution else {}
    headings = ("blank", *(("answer",) if solution else ("unit",)), "what is asked for")
    rows: list[Any] = []
    for blank in exercise.blanks:
        answer_text = blank.unit
        if solution:
            answer = answers[blank.id]
            answer_text = (answer.text or "not known").replace("−", "-")
        rows.append((blank.id, answer_text, line_text(blank.label)))
    show_table(console, headings, rows)
    why_not = [
        f"{name} can't be determined: {answer.why_not}" for name, answer in answers.items() if not answer.text
    ]
    for sentence in (*why_not, *(worked.unnoticed_mistakes if solution else ())):
        show_wrapped(console, Text("  ! ", style="bold yellow"), line_text(sentence), hanging=4)
    if not solution and not worked.given:
        first = exercise.blanks[0]
        console.print()
        text = (
            f'check your answers with --answer "{first.id}=..."; --studies shows the results, --solution also the right '
            "answers"
        )
        show_wrapped(console, Text(), text, hanging=0)


def _show_corrections(console: Console, worked: WorkedExercise) -> None:
    console.print(Text("Errors in the paper", style="bold"))
    for each in worked.corrections:
        console.print()
        show_wrapped(
            console, Text("  "), line_text(f"{each.correction.where}: {each.correction.paper}"), hanging=4
        )
        show_wrapped(console, Text("  here: ", style="bold"), line_text(each.ours), hanging=4)
        show_wrapped(console, Text("  why: "), line_text(each.correction.why), hanging=4)

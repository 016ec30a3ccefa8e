"""Layout of text and tables for a terminal or a text file: no trailing blanks, no broken names."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from textwrap import wrap

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

from servobench.cli.terminal import one_line, printable

_INDENT = "  "
_GAP = "  "
_NARROWEST = 20  # characters for the last column


def show_wrapped(console: Console, head: Text, sentence: str, *, hanging: int) -> None:
    """Print a sentence behind a head, its further lines behind that many blanks."""
    first, *further = _wrap(f"{head.plain}{printable(sentence)}", console.width, hanging)
    console.print(Text.assemble(head, first[len(head.plain) :]), soft_wrap=True)
    for line in further:
        console.print(line, soft_wrap=True)


def show_table(
    console: Console, headings: Sequence[str], rows: Sequence[Sequence[str]], *, right: Collection[str] = ()
) -> None:
    """Print rows below their headings; the last column is wrapped where a line would be too long.

    The columns with the headings in `right` hold numbers.
    """
    cells = [[one_line(cell) for cell in row] for row in rows]
    widths = [max(map(cell_len, column)) for column in zip(headings, *cells, strict=True)][:-1]
    styled = [("dim", list(headings)), *(("", row) for row in cells)]
    for style, row in styled:
        columns = zip(row[:-1], widths, headings[:-1], strict=True)
        start = _INDENT + "".join(_pad(cell, width, head in right) + _GAP for cell, width, head in columns)
        room = max(console.width, cell_len(start) + _NARROWEST)
        for line in _wrap(start + row[-1], room, cell_len(start)):
            console.print(Text(line, style=style), soft_wrap=True)


def _wrap(text: str, width: int, hanging: int) -> list[str]:
    """The lines of a text; the blanks that it begins with stay, further lines begin with that many."""
    indent = text[: len(text) - len(text.lstrip())]
    lines = wrap(
        text.lstrip(),
        width,
        initial_indent=indent,
        subsequent_indent=" " * hanging,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines or [""]


def _pad(cell: str, width: int, right: bool) -> str:
    blanks = " " * (width - cell_len(cell))
    return blanks + cell if right else cell + blanks

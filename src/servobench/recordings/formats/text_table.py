"""A table in a text file: its separator and decimal mark, its header and units, its numbers, and what is wrong with it.

If two readings make sense, nothing is guessed: a rule decides, or a `FormatError` says what to add to the file.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import FormatError
from servobench.core.finding import Finding, info, list_text, warning
from servobench.core.rounding import count_text
from servobench.core.units import is_unit
from servobench.recordings.formats.capture_clock import (
    CAPTURE_TIME,
    clock_column,
    is_the_time,
    without_clock,
)
from servobench.recordings.formats.columns import LARGEST_TABLE, Heading, heading, quote
from servobench.recordings.formats.common_factor import about_factor, common_factor
from servobench.recordings.formats.direction_words import about_direction, is_direction, signs_of
from servobench.recordings.formats.framed_rows import rules, without_frames
from servobench.recordings.formats.labelled_values import SEPARATOR, without_labels
from servobench.recordings.formats.listed_columns import column_names
from servobench.recordings.formats.start_and_increment import about_times, with_times
from servobench.recordings.formats.thousands import GROUPED_DIGITS, about_thousands, has_mark, without_marks
from servobench.recordings.formats.time_stamps import is_stamp, seconds_from_first
from servobench.recordings.formats.times import in_words
from servobench.recordings.formats.unreadable import Texts, about_columns, about_words

SEPARATORS = ("\t", ";", ",", "|", " ")
"""The possible separators; the blank stands for any run of blanks and tabs."""

_COMMENTS = ("#", "%", "//", ";")
_WORDS = r"[+-]?(?:nan|inf(?:inity)?)"
_NUMBER = {
    ".": re.compile(
        rf"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?|[+-]?{GROUPED_DIGITS}(?:\.[0-9]*)?|{_WORDS}",
        re.IGNORECASE,
    ),
    ",": re.compile(
        rf"[+-]?(?:[0-9]+(?:,[0-9]+)?|,[0-9]+)(?:e[+-]?[0-9]+)?|[+-]?{GROUPED_DIGITS}(?:,[0-9]+)?|{_WORDS}",
        re.IGNORECASE,
    ),
}
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}(?:,[0-9]{3})+")
_ONE_COMMA = re.compile(r"\s*[+-]?[0-9]+,[0-9]+(?:e[+-]?[0-9]+)?\s*", re.IGNORECASE)
_ZERO_AFTER_COMMA = re.compile(r",0[0-9]")
_BRACKETS = re.compile(r"[\[({]\s*(.*?)\s*[\])}]")
_REMARK = re.compile(r"\s*[#%]")
_EXCEL = re.compile(r"sep=(.)", re.IGNORECASE)
_SAMPLE = 300  # rows that the layout is found from, spread over the file
_SIGNALS, _SAMPLES = 5, 50  # rows at most, and columns at least, of a table that lies on its side
_FIRST = 1000  # rows by which the numbers must have begun
_BLOCK = 8192  # rows that are parsed at once; where that fails each of them is examined by itself
_FEW_OPEN, _SHARE_OPEN = 10, 0.01  # rows with a quote that isn't closed, which cost only themselves
_NO_NUMBER = "cell-not-a-number"
_MOST_COLUMNS = 12  # that a sentence names
LONGEST_LINE = 2**20
"""The most bytes of a line: a thousand columns, the most that a table may have, of a thousand characters each."""

_UNIT_SEPARATOR = "\x1f"  # of ASCII; stands between cells that had quotes


class OneOrTwoColumns(FormatError):
    """Rows of two whole numbers with a comma between them, which may be one number with a decimal comma."""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A table's notation: the separator (one of `SEPARATORS`, or another character) and the decimal mark.

    `columns` is the number of cells in a row; `trailing` separators follow the last of them.
    """

    separator: str
    decimal: str
    columns: int = 1
    trailing: int = 0

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line, without the blanks and quotes around them."""
        if '"' in line:
            return [cell.strip() for cell in _unquote(line, self.separator).split(_UNIT_SEPARATOR)]
        if self.separator == " ":
            return line.split()
        return [cell.strip() for cell in line.split(self.separator)]

    def row(self, line: str) -> list[str] | None:
        """Return as many cells as there are columns; None where the line has fewer, or more that aren't empty."""
        cells = self.cells(line)
        if len(cells) < self.columns or any(cells[self.columns :]):
            return None
        return cells[: self.columns]

    def is_number(self, cell: str) -> bool:
        """Return whether a cell is a number, NaN and infinity included."""
        return bool(_NUMBER[self.decimal].fullmatch(cell))

    def number(self, cell: str) -> float:
        """Return the number that a cell is, by `is_number`."""
        return float(without_marks(cell).replace(",", "."))


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A table of numbers: `headings` of its columns, values (N, M), and the row of the file that each of the N stands in.

    `findings` are what was seen while reading. `blank` are the rows of the file that are blank, `headers` those that repeat the
    names of the columns, `stamped` the columns whose values are seconds from the first time stamp.
    """

    headings: tuple[Heading, ...]
    values: Array
    rows: NDArray[np.int64]
    blank: NDArray[np.int64]
    findings: tuple[Finding, ...]
    headers: NDArray[np.int64]
    stamped: frozenset[int] = frozenset()


@dataclass(frozen=True, kw_only=True, eq=False)
class _Lines:
    """The lines of a file by what they are: `content` in its `rows` (from 1), comments by row, and the blank rows."""

    content: list[str]
    rows: NDArray[np.int64]
    comments: dict[int, str]
    blank: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class _Names:
    """Cells of a row above the numbers, which may name the columns or their units."""

    row: int
    cells: list[str]


def check_lines(data: bytes, name: str, begin: int = 0) -> None:
    """Raise `FormatError` where a line of a file's bytes, from the place `begin` on, is longer than any row of a table is."""
    while len(data) - begin > LONGEST_LINE:
        end = begin + LONGEST_LINE
        ended = max(data.rfind(b"\n", begin, end), data.rfind(b"\r", begin, end))
        if ended < 0:
            row = data.count(b"\n", 0, begin) + 1
            raise FormatError(
                f"{name}: row {row} has more than {LONGEST_LINE} characters, too many for a row of a table; is it "
                "another kind of file, or are its line ends lost?"
            )
        begin = ended + 1


def decode(data: bytes, name: str) -> tuple[str, tuple[Finding, ...]]:
    """Return the text in the bytes of a file, its lines ended by newlines alone; raises `FormatError` where it's no text."""
    findings: tuple[Finding, ...] = ()
    try:
        text = data.decode("utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
        sentence = (
            "The file isn't valid UTF-8 and is read as Latin-1: accents and signs in names may be wrong."
        )
        findings = (info("encoding-latin-1", sentence),)
    strange = sum(text.count(chr(code)) for code in range(32) if chr(code) not in "\t\n\r\f\x1a")
    # A serial line leaves a few bytes of noise in a log; a binary file has them everywhere.
    if strange > len(text) / 100:
        raise FormatError(
            f"{name} isn't a text file: {strange} of its {len(text)} characters are control characters"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n"), findings


def parse(text: str, name: str, separator: str | None = None, decimal: str | None = None) -> Table:
    """Return the table in a text; `separator` and `decimal` are found out where they aren't given.

    Raises `FormatError` where there are no numbers, or where two readings make sense.
    """
    sent, clocks = without_clock(text.split("\n"))
    lines = _sort_lines(sent)
    if lines.content and separator is None and (excel := _EXCEL.fullmatch(lines.content[0].strip())):
        separator = excel[1]
        lines = replace(lines, content=lines.content[1:], rows=lines.rows[1:])
    if not lines.content:
        raise FormatError(f"{name} has no rows: its lines are blank or comments")
    lines, about_times_above = _with_times_from_above(lines)
    lines, factor, about_notation = _without_notation(lines, name)
    if separator is None:
        lines, separator, about_labels = _without_labels(lines)
        about_notation += about_labels
    _check_quotes(lines, name)
    layout = _layout(lines.content, name, separator, decimal)
    start = _with_ragged_rows(lines.content, _first_row_of_numbers(lines.content, layout, name), layout)
    begin = int(lines.rows[start])
    above = [*(text for row, text in lines.comments.items() if row < begin), *lines.content[:start]]
    layout = _without_trailing(lines.content[start:], above, layout)
    if decimal is None:
        layout = _sure_of_commas(lines.content[start:], above, layout, name)
    headings, about_header, used = _headings(lines, start, layout)
    values, faults = numbers(lines.content[start:], layout)
    values *= factor
    faults.set_headers_apart(lines.content[start:], _rows_of_names(lines, start, used, layout), layout)
    headings, about_texts, stamped = _read_stamps(lines.content[start:], layout, headings, values, faults)
    about_texts += _read_directions(lines.content[start:], layout, headings, values, faults)
    _check_upright(values, name, layout.separator)
    usable = np.ones(len(values), dtype=bool)
    usable[[k for left_out in faults.rows.values() for k in left_out]] = False
    about_cells = _about_cells(
        faults,
        lines.rows[start:],
        [each.name or f"column_{c}" for c, each in enumerate(headings, 1)],
        values,
        usable,
    )
    findings = [
        *_about_marks(lines.content[start:], layout),
        *about_times_above,
        *about_notation,
        *about_header,
        *_about_lines(lines, start, used),
        *about_texts,
        *about_cells,
    ]
    table = Table(
        headings=headings,
        values=values[usable],
        rows=lines.rows[start:][usable],
        blank=lines.blank,
        findings=tuple(findings),
        headers=lines.rows[start:][faults.rows.get("header-repeated", [])],
        stamped=stamped,
    )
    return _with_clock(table, clocks) if clocks else table


def _about_marks(content: Sequence[str], layout: Layout) -> list[Finding]:
    """The findings on what stands inside numbers: separators between thousands, and decimal commas."""
    cells = (cell for line in content if has_mark(line) for cell in layout.row(line) or ())
    grouped = next((cell for cell in cells if has_mark(cell) and layout.is_number(cell)), None)
    findings = [] if grouped is None else [about_thousands(grouped)]
    if layout.decimal == ",":
        findings.append(info("decimal-comma", "The commas inside numbers are decimal marks."))
    return findings


def _check_upright(values: Array, name: str, separator: str) -> None:
    """Raise `FormatError` for a table that lies on its side, with a row for each signal and a column for each sample."""
    rows, columns = values.shape
    if rows <= _SIGNALS and columns >= _SAMPLES:
        between = f", delimiter={separator!r}" if separator.strip(" ") else ""
        raise FormatError(
            f"{name} has {count_text(rows, 'row')} of {columns} numbers, as if it lay on its side; write it with a column for "
            f'each signal and a row for each sample (in Python: `numpy.savetxt("upright.csv", numpy.loadtxt(FILE{between}).T)`)'
        )


def _with_clock(table: Table, clocks: Sequence[str]) -> Table:
    """The table with the clock times of the file's lines as its last column."""
    t, about_clock = clock_column([clocks[row - 1] for row in table.rows])
    is_time = is_the_time(table.headings)
    return replace(
        table,
        headings=(*table.headings, CAPTURE_TIME),
        values=np.column_stack((table.values, t)),
        findings=(about_clock, *table.findings),
        stamped=table.stamped | ({len(table.headings)} if is_time else set()),
    )


def _with_times_from_above(lines: _Lines) -> tuple[_Lines, list[Finding]]:
    """The lines with the times of an oscilloscope that gives a start and an increment, and the finding on it."""
    scope = with_times(lines.content)
    if scope is None:
        return lines, []
    content, start, increment = scope
    names, units = lines.rows[:2].tolist()
    finding = about_times(start, increment, (names, units))
    return replace(lines, content=content, rows=np.delete(lines.rows, 1)), [finding]


def _without_notation(lines: _Lines, name: str) -> tuple[_Lines, float, list[Finding]]:
    """The lines without what a program put around the rows, the common factor of their numbers, and the finding on it."""
    lines = replace(lines, content=without_frames(lines.content, _spread(lines.content)))
    place, factor = common_factor(lines.content, lines.rows, name)
    if place is None:
        return lines, 1.0, []
    finding = about_factor(factor, int(lines.rows[place]))
    content = [*lines.content[:place], *lines.content[place + 1 :]]
    return replace(lines, content=content, rows=np.delete(lines.rows, place)), factor, [finding]


def _without_labels(lines: _Lines) -> tuple[_Lines, str | None, list[Finding]]:
    """The lines without names and units beside the values, the separator where they had some, and the finding on them."""
    bare = without_labels(lines.content, _spread(lines.content)) if lines.content else None
    if bare is None:
        return lines, None, []
    rows = np.insert(lines.rows, bare.header, lines.rows[bare.header]) if bare.is_new else lines.rows
    return replace(lines, content=bare.lines, rows=rows), SEPARATOR, [bare.finding]


def _rows_of_names(lines: _Lines, start: int, used: frozenset[int], layout: Layout) -> list[list[str]]:
    """The cells of the rows above the numbers that name the columns and their units."""
    return [
        layout.cells(line)
        for row, line in zip(lines.rows[:start], lines.content, strict=False)
        if int(row) in used
    ]


def _read_stamps(
    content: Sequence[str], layout: Layout, headings: tuple[Heading, ...], values: Array, faults: Faults
) -> tuple[tuple[Heading, ...], list[Finding], frozenset[int]]:
    """Put seconds from the first time stamp where columns have time stamps; what was wrong with these cells is taken back."""
    texts = dict(faults.cells.get(_NO_NUMBER, {}))
    new, findings, stamped = list(headings), [], set()
    for c in [c for c in texts if is_stamp(faults.texts[c].example) and np.isnan(values[:, c]).all()]:
        cells = _cells_of_column(content, layout, c)
        values[:, c] = seconds_from_first(cells)
        example = faults.texts[c].example
        faults.read(c, {k: cells[k] for k in texts[c] if np.isnan(values[k, c])})
        new[c] = Heading(name=headings[c].name, unit="s")
        stamped.add(c)
        sentence = f"`{headings[c].name}` has time stamps such as {example!r}; they are read as seconds from the first."
        findings.append(info("time-stamps", sentence))
    return tuple(new), findings, frozenset(stamped)


def _read_directions(
    content: Sequence[str], layout: Layout, headings: tuple[Heading, ...], values: Array, faults: Faults
) -> list[Finding]:
    """Put signs where columns have words for a direction; what was wrong with these cells is taken back."""
    texts, findings = dict(faults.cells.get(_NO_NUMBER, {})), []
    for c in [c for c in texts if is_direction(faults.texts[c].example) and np.isnan(values[:, c]).all()]:
        cells = _cells_of_column(content, layout, c)
        signs = signs_of(cells)
        if signs is not None:
            values[:, c] = signs
            faults.read(c, {})
            findings.append(about_direction(headings[c].name or f"column_{c + 1}", cells))
    return findings


def _cells_of_column(content: Sequence[str], layout: Layout, c: int) -> list[str]:
    """The cells of column c, counted from 0; empty ones in rows that have another number of cells."""
    return [(layout.row(line) or [""] * layout.columns)[c] for line in content]


def _sort_lines(lines: Sequence[str]) -> _Lines:
    """The lines of a text by what they are; a semicolon begins a comment only where it separates nothing."""
    bare = [line.strip() for line in lines]
    marks: tuple[str, ...] = _COMMENTS
    if any(";" in line and not line.startswith(_COMMENTS) for line in bare):
        marks = _COMMENTS[:-1]
    comments = {k + 1: line.lstrip("#%/; \t") for k, line in enumerate(bare) if line.startswith(marks)}
    comments |= {k + 1: "" for k in rules(bare)}
    rows = _rows(k for k, line in enumerate(bare, 1) if line and k not in comments)
    return _Lines(
        content=[lines[row - 1] for row in rows],
        rows=rows,
        comments=comments,
        blank=_rows(k for k, line in enumerate(bare, 1) if not line),
    )


def _rows(numbers: Iterable[int]) -> NDArray[np.int64]:
    """Row numbers as an array, without a list of them: a file may have nothing but blank rows, one a byte."""
    return np.fromiter(numbers, dtype=np.int64)


def _check_quotes(lines: _Lines, name: str) -> None:
    """Raise `FormatError` if quotes stay open in more rows than a slip or two: the end of their cells isn't known."""
    is_open = np.fromiter((line.count('"') % 2 for line in lines.content), dtype=np.bool_)
    if is_open.sum() > max(_FEW_OPEN, _SHARE_OPEN * len(is_open)):
        raise FormatError(
            f"{name}: a quote isn't closed in {in_words(lines.rows[is_open])}; close the quotes, or export the file "
            "without them"
        )


def _spread(content: Sequence[str]) -> list[str]:
    """A sample of the lines, spread over all of them."""
    places = np.unique(np.linspace(0, len(content) - 1, min(len(content), _SAMPLE)).astype(int))
    return [content[k] for k in places]


def _layout(content: Sequence[str], name: str, separator: str | None, decimal: str | None) -> Layout:
    """The layout in which most rows are alike and most of their cells are numbers; of equals the one with most columns."""
    sample = _spread(content)
    quotes = any('"' in line for line in sample)
    best, best_score = None, (0.0, 0)
    for mark in SEPARATORS if separator is None else (separator,):
        for point in (".", ",") if decimal is None else (decimal,):
            if mark == point and not quotes:
                continue
            tried = Layout(separator=mark, decimal=point)
            rows = [tried.cells(line) for line in sample]
            columns = Counter(map(len, rows)).most_common(1)[0][0]
            cells = [cell for row in rows if len(row) == columns for cell in row]
            numbers = sum(map(tried.is_number, cells))
            # An empty cell speaks for a layout no less than a number; blanks as separators would never leave one.
            score = round((numbers + cells.count("")) / (columns * len(sample)), 6), columns
            if numbers and score > best_score:
                best, best_score = replace(tried, columns=columns), score
    if best is None:
        raise FormatError(f"{name} has no rows of numbers, only text such as {sample[0].strip()[:60]!r}")
    if best.columns > LARGEST_TABLE:
        raise FormatError(f"{name} has {best.columns} columns; expected at most {LARGEST_TABLE} channels")
    return best


def _first_row_of_numbers(content: Sequence[str], layout: Layout, name: str) -> int:
    """The first row that has numbers, or nothing, wherever most rows have numbers."""
    rows = [row for line in _spread(content) if (row := layout.row(line))]
    filled = [[row[c] for row in rows if row[c]] for c in range(layout.columns)]
    usual = [
        c for c, cells in enumerate(filled) if cells and 2 * sum(map(layout.is_number, cells)) >= len(cells)
    ]
    for k, line in enumerate(content[:_FIRST]):
        row = layout.row(line)
        if row is None or not any(layout.is_number(row[c]) for c in usual):
            continue
        if all(layout.is_number(row[c]) or not row[c] for c in usual):
            return k
    raise FormatError(f"{name} has no rows of numbers below {content[0].strip()[:60]!r}")


def _with_ragged_rows(content: Sequence[str], start: int, layout: Layout) -> int:
    """The first row of numbers, those included between the names of the columns and it that are too short, or hold a text."""
    first = start
    while first > 0 and _holds_numbers(layout.cells(content[first - 1]), layout):
        first -= 1
    # Below anything else a number may be one of rows, or of samples a second.
    return first if first > 0 and _are_names(_names_in(content[first - 1], layout), layout) else start


def _holds_numbers(cells: Sequence[str], layout: Layout) -> bool:
    """Whether cells are numbers only, or a row of which at least half are."""
    count = sum(map(layout.is_number, cells))
    return count > 0 and (count == len(cells) or (len(cells) == layout.columns and 2 * count >= len(cells)))


def _without_trailing(content: Sequence[str], above: Sequence[str], layout: Layout) -> Layout:
    """The layout without columns at the end that are always empty and have no name."""
    rows = [row for line in _spread(content) if (row := layout.row(line))]
    named = max((len(_names_in(line, replace(layout, columns=0))) for line in above), default=0)
    columns = layout.columns
    while columns > max(named, 1) and not any(row[columns - 1] for row in rows):
        columns -= 1
    return replace(layout, columns=columns, trailing=layout.columns - columns)


def _sure_of_commas(content: Sequence[str], above: Sequence[str], layout: Layout, name: str) -> Layout:
    """The layout with the meaning of its commas settled; raises `FormatError` if it is ambiguous."""
    named = len(_names_in(above[-1], layout)) if above else 0
    if layout.separator == "," and layout.columns == 2 and all(_may_be_one(line, layout) for line in content):
        if named == 2:
            return layout
        if named == 1 or any(map(_ZERO_AFTER_COMMA.search, content)):
            return Layout(separator=" ", decimal=",")
        raise OneOrTwoColumns(
            f"{name}: rows such as {content[0].strip()!r} may be two whole numbers or one with a decimal comma; if there are two "
            "columns, say what the second is by its number, such as `output=2:UNIT`; otherwise add a first row that names "
            "the column"
        )
    if (
        layout.separator == ","
        and named > 1
        and 2 * named == layout.columns
        and not any("." in line for line in content)
    ):
        raise FormatError(
            f"{name}: {named} columns are named and rows such as {content[0].strip()[:60]!r} have {layout.columns} cells: "
            "the comma seems to be both separator and decimal mark; separate the columns by semicolons or tabs"
        )
    if layout.decimal == ",":
        with_comma = (cell for line in content for cell in layout.cells(line) if "," in cell)
        numbers = (cell for cell in with_comma if layout.is_number(cell))
        example = next(numbers, None)
        if example and _THOUSANDS.fullmatch(example) and all(map(_THOUSANDS.fullmatch, numbers)):
            raise FormatError(
                f"{name}: the comma in numbers such as {example!r} may be a decimal mark, or group thousands; write the "
                "numbers with a decimal point, or read the file in Python with Csv(decimal=',')"
            )
    return layout


def _may_be_one(line: str, layout: Layout) -> bool:
    """Whether two numbers with a comma between them may be one; a damaged row is no evidence against it."""
    return bool(_ONE_COMMA.fullmatch(line)) or not all(map(layout.is_number, layout.row(line) or [""]))


def _names_in(line: str, layout: Layout) -> list[str]:
    """The cells of a row of names, without empty ones beyond the columns; a unit in brackets belongs to the name before it."""
    if layout.separator == " ":
        cells = [cell.replace("\0", " ") for cell in layout.cells(re.sub(r"\s+(?=[\[({])", "\0", line))]
    else:
        cells = layout.cells(line)
    while len(cells) > layout.columns and not cells[-1]:
        cells.pop()
    return cells


def _headings(
    lines: _Lines, start: int, layout: Layout
) -> tuple[tuple[Heading, ...], list[Finding], frozenset[int]]:
    """The headings of the columns, what is to be known of them, and the rows that they stand in."""
    begin = int(lines.rows[start])
    above = [
        _Names(row=int(r), cells=_names_in(line, layout))
        for r, line in zip(lines.rows[:start], lines.content, strict=False)
    ]
    comments = [
        _Names(row=r, cells=_names_in_comment(text, layout))
        for r, text in lines.comments.items()
        if r < begin
    ]
    header = _header(above, layout)
    findings: list[Finding] = []
    if not header and layout.columns > 1:
        listed = column_names({r: text for r, text in lines.comments.items() if r < begin}, layout.columns)
        if listed:
            names = list(listed.values())
            sentence = f"The names of the columns are taken from comments: {quote(names)}."
            in_comments = info("header-in-comment", sentence, rows=(min(listed), max(listed)))
            unused = _about_unused(above, layout, has_header=True)
            return _with_units(names, []), [in_comments, *unused], frozenset(listed)
        header = _header([each for each in comments if _are_names(each.cells, layout)], layout)
        if header:
            sentence = f"The names of the columns are taken from a comment: {quote(header[0].cells)}."
            findings.append(info("header-in-comment", sentence, rows=(header[0].row, header[0].row)))
    used = frozenset(each.row for each in header)
    findings.extend(_about_unused([each for each in above if each.row not in used], layout, bool(header)))
    if not header:
        names = [f"column_{number}" for number in range(1, layout.columns + 1)]
        findings.append(info("header-missing", f"No row names the columns; they are called {quote(names)}."))
        return tuple(Heading(name=name) for name in names), findings, used
    units = header[1].cells if len(header) > 1 else []
    return _with_units(header[0].cells, units), findings, used


def _names_in_comment(text: str, layout: Layout) -> list[str]:
    """The cells of a comment, which may separate the names of the columns in another way than the numbers are."""
    for separator in (layout.separator, *SEPARATORS):
        cells = _names_in(text, replace(layout, separator=separator))
        # `t, u` between blanks would be a name with a comma, and `4 motor voltage` is the fourth of several names.
        if (
            _are_names(cells, layout)
            and not layout.is_number(cells[0])
            and not any(cell.endswith((",", ";")) for cell in cells)
        ):
            return cells
    return []


def _header(above: Sequence[_Names], layout: Layout) -> Sequence[_Names]:
    """The row of names just above the numbers; and after it the row of units, where there is one between."""
    if len(above) > 1 and _are_units(above[-1].cells, layout) and _are_names(above[-2].cells, layout):
        return above[-2:]
    # What a program says when it starts or stops may stand between, in another number of cells.
    fitting = [each for each in above if len(each.cells) == layout.columns > 1] or list(above)
    return fitting[-1:] if fitting and _are_names(fitting[-1].cells, layout) else []


def _are_names(cells: Sequence[str], layout: Layout) -> bool:
    """Whether cells can name the columns: there is one for each, and most of them are no numbers."""
    filled = [cell for cell in cells if cell]
    return len(cells) == layout.columns and 2 * sum(map(layout.is_number, filled)) < len(filled)


def _are_units(cells: Sequence[str], layout: Layout) -> bool:
    inside = [_bare(cell) for cell in cells if cell]
    return 0 < len(cells) <= layout.columns and all(
        is_unit(text) or text in {"", "-", "#"} for text in inside
    )


def _bare(cell: str) -> str:
    """A unit without the brackets around it."""
    brackets = _BRACKETS.fullmatch(cell)
    return brackets[1] if brackets else cell


def _with_units(names: Sequence[str], units: Sequence[str]) -> tuple[Heading, ...]:
    headings = [heading(name) for name in names]
    for k, text in enumerate(units):
        if is_unit(_bare(text)):
            headings[k] = Heading(name=headings[k].name, unit=_bare(text))
    return tuple(headings)


def _about_unused(unused: Sequence[_Names], layout: Layout, has_header: bool) -> list[Finding]:
    """Findings on the rows above the numbers that aren't their header."""
    findings = []
    if unused and not has_header and len(unused[-1].cells) > 1:
        *unused, last = unused
        cells = f"{len(last.cells)} cells and the rows of numbers {layout.columns}"
        why = f"has {cells}" if len(last.cells) != layout.columns else "is neither names nor numbers"
        sentence = f"Row {last.row} ({quote(last.cells)}) {why}: it isn't used."
        findings.append(warning("header-mismatch", sentence, rows=(last.row, last.row)))
    if unused:
        rows = np.array([each.row for each in unused])
        sentence = f"The text above the table isn't read: {in_words(rows)}."
        findings.append(info("preamble-skipped", sentence, rows=(int(rows[0]), int(rows[-1]))))
    return findings


def _about_lines(lines: _Lines, start: int, used: frozenset[int]) -> list[Finding]:
    """Findings on blank rows between the numbers, and on comments."""
    findings = []
    first, last = int(lines.rows[start]), int(lines.rows[-1])
    blank = lines.blank[(lines.blank > first) & (lines.blank < last)]
    if len(blank):
        findings.append(_finding(info, "rows-blank", "Blank:", blank))
    comments = np.array([row for row in lines.comments if row not in used], dtype=np.int64)
    if len(comments):
        findings.append(_finding(info, "rows-comment", "Comments, which aren't read:", comments))
    return findings


def _finding(
    severity: Callable[..., Finding], code: str, what: str, rows: NDArray[np.int64], more: str = ""
) -> Finding:
    return severity(code, f"{what} {in_words(rows)}{more}.", rows=(int(rows[0]), int(rows[-1])))


@dataclass(kw_only=True)
class Faults:
    """The faults in the rows of a table, counted from 0: rows to leave out, and cells by column; the kinds by code.

    `remarks` are rows with a comment behind their numbers, `texts` and `examples` what stands by column where a number should.
    """

    rows: dict[str, list[int]] = field(default_factory=dict)
    cells: dict[str, dict[int, list[int]]] = field(default_factory=dict)
    remarks: list[int] = field(default_factory=list)
    texts: dict[int, Texts] = field(default_factory=dict)
    examples: dict[int, str] = field(default_factory=dict)

    @property
    def example(self) -> str:
        """A text that stands where a number should."""
        return next(iter(self.examples.values()), "")

    def row(self, code: str, k: int) -> None:
        """Note a row that can't be used."""
        self.rows.setdefault(code, []).append(k)

    def cell(self, code: str, k: int, c: int, text: str) -> None:
        """Note a cell of row k and column c that is no number."""
        self.cells.setdefault(code, {}).setdefault(c, []).append(k)
        if text:
            self.examples.setdefault(c, text)
            self.texts.setdefault(c, Texts()).add(text)

    def set_headers_apart(
        self, content: Sequence[str], headers: Sequence[Sequence[str]], layout: Layout
    ) -> None:
        """Note which rows without a number repeat one of the `headers`, or stand right above such a row."""
        rows = self.rows.get("row-without-numbers", [])
        again = {k for k in rows if layout.cells(content[k]) in headers}
        again |= {k for k in rows if k + 1 in again}
        if not again:
            return
        self.rows["header-repeated"] = sorted(again)
        self.rows["row-without-numbers"] = [k for k in rows if k not in again]
        if not self.rows["row-without-numbers"]:
            del self.rows["row-without-numbers"]

    def read(self, c: int, left: Mapping[int, str]) -> None:
        """Take back what was noted of texts in column c, but for what is left by row, as they were read after all."""
        del self.cells[_NO_NUMBER][c], self.texts[c], self.examples[c]
        if not self.cells[_NO_NUMBER]:
            del self.cells[_NO_NUMBER]
        for k, text in left.items():
            self.cell(_NO_NUMBER, k, c, text)

    def take_words(self, values: Array) -> dict[int, str]:
        """Take back what was noted of columns of `values` (N, M) without any number, and return an example of each."""
        words = {c: self.examples[c] for c in sorted(self.texts) if np.isnan(values[:, c]).all()}
        for c in words:
            self.read(c, {})
        return words


def numbers(content: Sequence[str], layout: Layout) -> tuple[Array, Faults]:
    """Return the numbers in lines (N, M), NaN where there is none, and what is wrong with cells and rows."""
    faults = Faults()
    blocks = [np.empty((0, layout.columns))]
    for begin in range(0, len(content), _BLOCK):
        lines = content[begin : begin + _BLOCK]
        values = _parse_at_once(lines, layout)
        blocks.append(_parse_singly(lines, layout, begin, faults) if values is None else values)
    return np.concatenate(blocks), faults


def _parse_at_once(lines: Sequence[str], layout: Layout) -> Array | None:
    """The numbers in rows that are all in order; None where they aren't."""
    separator = layout.separator
    if any('"' in line for line in lines):
        lines = [_unquote(line, separator) for line in lines]
        separator = _UNIT_SEPARATOR
    if layout.trailing:
        lines = [line.rstrip(" ").removesuffix(separator * layout.trailing) for line in lines]
    if layout.decimal == ",":
        # A point is no part of such a number: what has one must not pass.
        lines = [line.replace(".", "?").replace(",", ".") for line in lines]
    try:
        values = np.loadtxt(lines, delimiter=separator.strip(" ") or None, comments=None, ndmin=2)
    except ValueError:
        return None
    return values if values.shape == (len(lines), layout.columns) else None


def _unquote(line: str, separator: str) -> str:
    """A line whose cells may have quotes around them, with the ASCII unit separator between the cells instead."""
    if separator == " ":
        line = line.strip().replace("\t", " ")
    try:
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return line
    return _UNIT_SEPARATOR.join(cell.replace("\n", " ") for cell in cells)


def _parse_singly(lines: Sequence[str], layout: Layout, begin: int, faults: Faults) -> Array:
    """The numbers in rows (N, M), NaN where there is none, with what is wrong added to `faults`."""
    values = np.full((len(lines), layout.columns), np.nan)
    for at, line in enumerate(lines):
        k, row = begin + at, layout.row(line)
        if (numbers_alone := _without_remark(line, layout)) is not None:
            faults.remarks.append(k)
            row = numbers_alone
        if row is None:
            faults.row(_row_fault(layout.cells(line), layout), k)
        elif not any(map(layout.is_number, row)):
            faults.row("row-without-numbers", k)
        else:
            for c, cell in enumerate(row):
                if layout.is_number(cell):
                    values[at, c] = layout.number(cell)
                else:
                    faults.cell(_NO_NUMBER if cell else "cell-empty", k, c, cell)
    return values


def _row_fault(cells: Sequence[str], layout: Layout) -> str:
    """The code of a row without a cell for each column; one without a number is text that a program prints between samples."""
    if not any(map(layout.is_number, cells)):
        return "rows-text"
    return "row-short" if len(cells) < layout.columns else "row-long"


def _without_remark(line: str, layout: Layout) -> list[str] | None:
    """The cells of a row of numbers before a comment in it; None where there is none, or where it isn't whole without."""
    remark = _REMARK.search(line)
    row = layout.row(line[: remark.start()]) if remark else None
    return row if row is not None and all(map(layout.is_number, row)) else None


def _about_cells(
    faults: Faults, rows: NDArray[np.int64], names: Sequence[str], values: Array, usable: NDArray[np.bool_]
) -> list[Finding]:
    """The findings on columns of words, on faults, and on columns with many texts, of values (N, M); `usable` (N,) are used."""
    words = faults.take_words(values)
    nan = np.isnan(values) & usable[:, None]
    nan[:, list(words)] = False
    return [
        *(about_words(names[c], example) for c, example in words.items()),
        *_about_faults(faults, rows, names, nan),
        *about_columns(faults.texts, names, len(values)),
    ]


def _about_faults(
    faults: Faults, rows: NDArray[np.int64], names: Sequence[str], nan: NDArray[np.bool_]
) -> list[Finding]:
    """A finding for each kind of thing that is wrong; `nan` (N, M) are the NaNs in the rows that are used."""
    sentences = {
        "row-short": f"Fewer than {len(names)} cells, left out:",
        "row-long": f"More than {len(names)} cells, left out:",
        "row-without-numbers": "Without any number, left out:",
        "header-repeated": "Repeated names of the columns, not read:",
        "rows-text": "Text between the rows of numbers, not read:",
        "cell-empty": "Empty cells, read as NaN:",
        _NO_NUMBER: f"Text where a number should be, such as {faults.example[:40]!r}, read as NaN:",
    }
    findings = []
    for code, left_out in faults.rows.items():
        severity = info if code in {"rows-text", "header-repeated"} else warning
        findings.append(_finding(severity, code, sentences[code], rows[left_out]))
    for code, by_column in faults.cells.items():
        where = rows[np.unique(np.concatenate([np.array(indices) for indices in by_column.values()]))]
        findings.append(_finding(info, code, sentences[code], where, _columns(by_column, names)))
    if faults.remarks:
        findings.append(
            _finding(info, "rows-remark", "Comments after the numbers, not read:", rows[faults.remarks])
        )
    spelled = nan.copy()
    for by_column in faults.cells.values():
        for c, indices in by_column.items():
            spelled[indices, c] = False
    if spelled.any():
        where, columns = rows[spelled.any(axis=1)], np.flatnonzero(spelled.any(axis=0))
        findings.append(_finding(info, "cell-nan", "Cells that say NaN:", where, _columns(columns, names)))
    return findings


def _columns(columns: Iterable[int], names: Sequence[str]) -> str:
    """The end of a sentence on cells: in which columns they are, twelve at the most."""
    return f", in {list_text([f'`{names[c]}`' for c in sorted(columns)[:_MOST_COLUMNS]])}"

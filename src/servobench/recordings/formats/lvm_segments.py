"""The segments of a LabVIEW measurement file in text: how its header says that rows are written, and the channels in them.

Source: National Instruments, "Specification for the LabVIEW Measurement File (.lvm)".
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import FormatError
from servobench.core.finding import Finding, info, warning
from servobench.recordings.formats import text_table
from servobench.recordings.formats.columns import LARGEST_TABLE, Column, distinct, heading, with_unit
from servobench.recordings.formats.times import in_words

MARK = "LabVIEW Measurement"
"""The first bytes of a file."""

_END = "***End_of_Header***"
_SPECIAL = "***Start_Special***"
_END_OF_SPECIAL = "***End_Special***"
_COMMENT = "Comment"
_SEPARATORS = {"tab": "\t", "comma": ",", "semicolon": ";"}
_X_COLUMNS = ("no", "one", "multi")
_CLOCK = re.compile(r"(\d{1,2}):(\d{1,2}):(\d{1,2})(?:[.,](\d+))?", re.ASCII)


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A block of rows: its channels as columns with times of their own, where they have any, and when it begins.

    `start` is the clock of the computer, in ns; None where the header doesn't say it. `rows` are its first and last in the file,
    `findings` what was seen while reading.
    """

    columns: tuple[Column, ...]
    start: int | None
    rows: tuple[int, int]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, kw_only=True)
class File:
    """The lines of a file behind its header, the first of them being line `first`, and how they are written.

    `separator` stands between cells, `decimal` is the point or comma in a number, and `x_columns` says which columns hold times:
    "no", "one" for all, or "multi" for one before each channel.
    """

    lines: Sequence[str]
    first: int
    separator: str
    decimal: str
    x_columns: str

    @classmethod
    def read(cls, text: str, name: str) -> File:
        """Return the file in a text; raises `FormatError` where its header doesn't say how the rows are written."""
        lines = _without_special_blocks(text.split("\n"))
        end = next((k for k, line in enumerate(lines) if line.strip().startswith(_END)), None)
        if not text.startswith(MARK) or end is None:
            raise FormatError(
                f"{name} isn't a LabVIEW measurement file: it lacks a header that ends in {_END}"
            )
        # The header is written with the separator that it names, and a tab where it names none.
        fields = {
            match[1].lower(): match[2].strip()
            for line in lines[:end]
            if (match := re.match(r"(\w+)[\t,;]([^\t;]*)", line))
        }
        separator = _SEPARATORS.get(fields.get("separator", "tab").rstrip(",").lower())
        decimal = fields.get("decimal_separator", ".")
        x_columns = fields.get("x_columns", "one").rstrip(",").lower()
        if (
            separator is None
            or decimal not in {".", ","}
            or x_columns not in _X_COLUMNS
            or separator == decimal
        ):
            raise FormatError(
                f"{name}: the header says Separator {fields.get('separator')!r}, Decimal_Separator {decimal!r} and X_Columns "
                f"{fields.get('x_columns')!r}; expected Tab or Comma, a point or a comma other than it, and No, One or Multi"
            )
        return cls(
            lines=lines[end + 1 :], first=end + 2, separator=separator, decimal=decimal, x_columns=x_columns
        )

    def segments(self, name: str) -> Iterator[Segment]:
        """The segments; raises `FormatError` where one has no header or no row of names."""
        ends = [k for k, line in enumerate(self.lines) if line.strip().startswith(_END)]
        if not ends:
            raise FormatError(f"{name} has no segment: a second {_END} is missing")
        begins = [self._begin(end, after) for end, after in zip(ends, [-1, *ends], strict=False)]
        for begin, end, until in zip(begins, ends, [*begins[1:], len(self.lines)], strict=True):
            header = {
                cells[0].strip().lower(): cells[1:]
                for line in self.lines[begin:end]
                if (cells := line.split(self.separator)) and cells[0].strip()
            }
            yield _segment(self, header, end + 1, until, name)

    def _begin(self, end: int, before: int) -> int:
        """The first line of the header that ends in line `end`: its line `Channels`, or the one after the last row of numbers."""
        for k in range(end - 1, before, -1):
            if self.lines[k].split(self.separator)[0].strip().lower() == "channels":
                return k
        return before + 1


def _without_special_blocks(lines: Sequence[str]) -> list[str]:
    """The lines with those of special blocks blanked, so that rows keep their numbers."""
    ordinary_lines = []
    inside = False
    for line in lines:
        inside = inside or line.strip().startswith(_SPECIAL)
        ordinary_lines.append("" if inside else line)
        if line.strip().startswith(_END_OF_SPECIAL):
            inside = False
    return ordinary_lines


def _segment(
    file: File, header: Mapping[str, Sequence[str]], names_at: int, until: int, name: str
) -> Segment:
    """The segment whose row of names is line `names_at` and whose rows end before line `until`."""
    cells = [cell.strip() for cell in file.lines[names_at].split(file.separator)] if names_at < until else []
    places = _places(cells, file.x_columns)
    if not places:
        row = names_at + file.first
        raise FormatError(
            f"{name}: row {row} names no channels; expected X_Value, a name for each channel and Comment"
        )
    if len(places) > LARGEST_TABLE:
        raise FormatError(f"{name}: {len(places)} channels; expected at most {LARGEST_TABLE} in a recording")
    lines = [(k, file.lines[k]) for k in range(names_at + 1, until) if file.lines[k].strip()]
    rows = np.array([k + file.first for k, _ in lines], dtype=np.int64)
    table, findings = _numbers([line for _, line in lines], rows, file, places)
    labels, _ = distinct([cells[y] for _, y in places])
    columns, starts = [], []
    for c, label in enumerate(labels):
        column, start, column_findings = _column(
            table[:, 2 * c], table[:, 2 * c + 1], _Header(header, c, file.decimal), label
        )
        columns.append(column)
        starts.append(start)
        findings.extend(column_findings)
    span = (int(rows[0]), int(rows[-1])) if len(rows) else (0, 0)
    nonempty = [k for k, column in enumerate(columns) if len(column.values)]
    known = [start for k in nonempty if (start := starts[k]) is not None]
    zero = min(known) if nonempty and len(known) == len(nonempty) else None
    if zero is not None:
        columns = [later(each, (start or zero) - zero) for each, start in zip(columns, starts, strict=True)]
    return Segment(
        columns=tuple(columns[k] for k in nonempty), start=zero, rows=span, findings=tuple(findings)
    )


def later(column: Column, nanoseconds: int) -> Column:
    """A column with all its times later."""
    if column.t is None or not nanoseconds:
        return column
    return replace(column, t=column.t + nanoseconds / 1e9)


def _places(cells: Sequence[str], x_columns: str) -> list[tuple[int | None, int]]:
    """The columns of each channel's X, None without one, and Y; comments come last."""
    last = len(cells) - 1 if cells and cells[-1] == _COMMENT else len(cells)
    while last and not cells[last - 1]:
        last -= 1
    if x_columns == "multi":
        return [(k, k + 1) for k in range(0, last - 1, 2)]
    return [(0 if x_columns == "one" else None, k) for k in range(1, last)]


def _numbers(
    lines: Sequence[str], rows: NDArray[np.int64], file: File, places: Sequence[tuple[int | None, int]]
) -> tuple[Array, list[Finding]]:
    """X and Y of each channel side by side (N, 2M), NaN where there is none, and what is wrong with the rows."""
    wanted = sorted({k for pair in places for k in pair if k is not None})
    short = []
    uniform_lines = []
    for k, line in enumerate(lines):
        cells = line.split(file.separator)
        if len(cells) <= wanted[0]:
            short.append(k)
        cells.extend([""] * (wanted[-1] + 1 - len(cells)))
        uniform_lines.append(";".join([cells[c].strip() or "nan" for c in wanted]))
    layout = text_table.Layout(separator=";", decimal=file.decimal, columns=len(wanted))
    values, faults = text_table.numbers(uniform_lines, layout)
    findings = []
    if short:
        sentence = f"Rows without a number: {in_words(rows[short])}."
        findings.append(
            warning("row-without-numbers", sentence, rows=(int(rows[short[0]]), int(rows[short[-1]])))
        )
    wrong = sorted({k for by in faults.cells.values() for indices in by.values() for k in indices} | {
        k for indices in faults.rows.values() for k in indices
    })  # fmt: skip
    if wrong:
        sentence = f"Text where a number should be, such as {faults.example[:40]!r}, read as NaN: {in_words(rows[wrong])}."
        findings.append(info("cell-not-a-number", sentence, rows=(int(rows[wrong[0]]), int(rows[wrong[-1]]))))
    at = {c: k for k, c in enumerate(wanted)}
    table = np.full((len(values), 2 * len(places)), np.nan)
    for k, (x, y) in enumerate(places):
        if x is not None:
            table[:, 2 * k] = values[:, at[x]]
        table[:, 2 * k + 1] = values[:, at[y]]
    return table, findings


@dataclass(frozen=True)
class _Header:
    """A segment's header for channel number `channel`, from 0."""

    fields: Mapping[str, Sequence[str]]
    channel: int
    decimal: str

    def text(self, key: str) -> str:
        """The text of a field; empty where there is none."""
        cells = self.fields.get(key.lower(), ())
        return cells[self.channel].strip() if self.channel < len(cells) else ""

    def number(self, key: str) -> float | None:
        """The number of a field, None where it is none."""
        layout = text_table.Layout(separator=";", decimal=self.decimal)
        text = self.text(key)
        if not layout.is_number(text) or not np.isfinite(value := layout.number(text)):
            return None
        return value

    def start(self) -> int | None:
        """The channel's start, in ns since the year 1; None where date or time are missing."""
        clock = _CLOCK.fullmatch(self.text("Time"))
        try:
            day = datetime.strptime(self.text("Date").replace("-", "/"), "%Y/%m/%d")
        except ValueError:
            return None
        if clock is None:
            return None
        hours, minutes, seconds, fraction = clock.groups()
        whole = 3600 * int(hours) + 60 * int(minutes) + int(seconds)
        return (86400 * day.toordinal() + whole) * 10**9 + int((fraction or "")[:9].ljust(9, "0"))


def _column(
    x: Array, y: Array, header: _Header, label: str
) -> tuple[Column, int | None, tuple[Finding, ...]]:
    """The column of a channel with its times, when it begins, and what is to be known of it."""
    head, findings = with_unit(heading(label), header.text("Y_Unit_Label"))
    # Shorter channels are filled up with empty cells.
    filled = np.flatnonzero(np.isfinite(y) | np.isfinite(x))
    count = int(filled[-1]) + 1 if len(filled) else 0
    samples = header.text("Samples")
    if samples.isdecimal() and len(samples) < 10 and count < int(samples):
        sentence = f"`{head.name}` has {count} samples where its header says {samples}."
        findings = (*findings, warning("samples-missing", sentence))
    values = np.ascontiguousarray(y[:count])
    if np.isfinite(x[:count]).any():
        # These may be times of the day themselves: what the header says of the start adds nothing to them.
        return Column(heading=head, values=values, t=np.ascontiguousarray(x[:count])), None, findings
    begin, step = header.number("X0"), header.number("Delta_X")
    dimension = header.text("X_Dimension").lower()
    if step is None or step <= 0.0 or dimension not in {"", "time"}:
        return Column(heading=head, values=values), header.start(), findings
    with np.errstate(over="ignore"):
        t = (begin or 0.0) + step * np.arange(count, dtype=np.float64)
    return Column(heading=head, values=values, t=t), header.start(), findings

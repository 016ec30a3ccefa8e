"""Text tables: CSV and its relatives, foreign ones and servobench's own, which contain a whole recording.

The first line of our own file is a comment with the recording's description (`metadata.py`) and the layout of the table:
channels with the same times follow a column of these times, and a shorter group ends in empty cells.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, final

import numpy as np

from servobench.core.channels import Array, Channel
from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding
from servobench.recordings.formats import metadata
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.recording import Recording, Series, Source

if TYPE_CHECKING:  # what only reading needs is imported there: every run writes a text table
    from servobench.recordings.formats import text_table

_JSON = re.compile(r'\s*(\{|\[\s*[\[{"0-9-])')
_MARK = f"# {metadata.SCHEMA} "
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')  # in JSON
# A cell that begins with one of these is a formula to a spreadsheet; where one begins depends on what it takes for a separator.
_FORMULA = re.compile(r"""((?:^|[,;|"'])\s*|\\t)([=+\-@])""")


@final
@FORMATS.member("csv")
@dataclass(frozen=True, kw_only=True)
class Csv:
    """Text tables. `separator` and the `decimal` mark are found out where they aren't given."""

    separator: str | None = None
    decimal: str | None = None

    suffixes: ClassVar[tuple[str, ...]] = (".csv", ".txt", ".tsv", ".dat")
    written: ClassVar[tuple[str, ...]] = suffixes
    by_library: ClassVar[bool] = False

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a text with rows of numbers."""
        from servobench.recordings.formats import lvm_segments, text_table

        if len(head) == 4096 and not head.startswith((b"\xff\xfe", b"\xfe\xff")):
            head = head[: max(head.rfind(b"\n"), head.rfind(b"\r")) + 1] or head  # the last line may be cut
        try:
            text, _ = text_table.decode(head, path.name)
            if _JSON.match(text) or text.startswith(lvm_segments.MARK):
                return False
            return text.startswith(_MARK) or bool(text_table.parse(text, path.name).headings)
        except FormatError:
            return False

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recordings in a text table, one for each of its blocks; raises `FormatError` where it can't be read."""
        from servobench.recordings.formats import text_blocks, text_table

        data = path.read_bytes()
        # What a recording of ours knows of itself stands in the first line, however much it is.
        text_table.check_lines(
            data, path.name, data.find(b"\n") + 1 if data.startswith(_MARK.encode()) else 0
        )
        text, findings = text_table.decode(data, path.name)
        if text.startswith(_MARK):
            return (_own(text, path.name),)
        table = text_table.parse(text, path.name, self.separator, self.decimal)
        blocks = text_blocks.blocks(table)
        findings = (*findings, *table.findings, *text_blocks.about_blocks(table, blocks))
        return tuple(
            _foreign(table, block, path, f" {k}" if len(blocks) > 1 else "", findings)
            for k, block in enumerate(blocks, 1)
        )

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write a recording with all its digits and all that it knows; raises `UsageError` for more than one."""
        if len(recordings) != 1:
            raise UsageError(
                f"{path.name}: a text table holds one recording and there are {len(recordings)}; "
                "write each to a file of its own, or all of them to an .mcap file"
            )
        (recording,) = recordings
        groups = _groups(recording.series)
        layout = [
            {"timed": group.t is not None, "channels": group.channels, "rows": group.rows} for group in groups
        ]
        head = _harmless_json(
            metadata.as_text({"recording": metadata.describe(recording), "columns": layout})
        )
        columns = [column for group in groups for column in group.columns]
        with path.open("w", encoding="utf-8", errors="backslashreplace", newline="\n") as file:
            file.write(f"{_MARK}{head}\n")
            if columns:
                file.write(_row(label for group in groups for label in group.labels))
                file.writelines(_rows(columns))


def _foreign(
    table: text_table.Table, block: slice, path: Path, number: str, findings: tuple[Finding, ...]
) -> Recording:
    """The recording that a block of rows of a table is."""
    from servobench.recordings.formats.columns import Column, recording_of

    columns = [
        Column(
            heading=heading, values=np.ascontiguousarray(table.values[block, k]), is_time=k in table.stamped
        )
        for k, heading in enumerate(table.headings)
    ]
    source = Source(name=path.name, format="csv")
    name = f"{path.stem}{number}"
    return recording_of(columns, name=name, source=source, findings=findings, rows=table.rows[block])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Group:
    """Series of one recording that share their times `t`, or have none and are equally long; `channels` are their numbers."""

    number: int
    t: Array | None
    rows: int
    channels: list[int]
    series: list[Series]

    @property
    def columns(self) -> list[Array]:
        values = [series.values for series in self.series]
        return values if self.t is None else [self.t, *values]

    @property
    def labels(self) -> list[str]:
        """The headers of the columns, for people: the names that count stand in the first line."""
        names = [_label(series.channel) for series in self.series]
        return names if self.t is None else [f"t{f'_{self.number}' if self.number > 1 else ''} [s]", *names]


def _groups(series: Sequence[Series]) -> list[_Group]:
    """The series by their times, in the order in which the first of each group comes."""
    groups: list[_Group] = []
    for k, each in enumerate(series):
        for group in groups:
            if _same_times(group.t, each.t) and group.rows == len(each.values):
                group.channels.append(k)
                group.series.append(each)
                break
        else:
            rows, number = len(each.values), len(groups) + 1
            groups.append(_Group(number=number, t=each.t, rows=rows, channels=[k], series=[each]))
    return groups


def _same_times(a: Array | None, b: Array | None) -> bool:
    if a is None or b is None:
        return a is b
    return a is b or np.array_equal(a, b, equal_nan=True)


def _label(channel: Channel) -> str:
    name = " ".join(channel.name.split())
    return name if channel.unit is None else f"{name} [{channel.unit}]"


def _row(cells: Iterator[str]) -> str:
    """A row of names; one that begins like a comment, or has a separator in it, gets quotes, and one like a formula another."""
    text = io.StringIO()
    names = [_FORMULA.sub(r"\1'\2", " ".join(cell.split())) for cell in cells]
    csv.writer(text, lineterminator="\n").writerow(names)
    return text.getvalue()


def _harmless_json(text: str) -> str:
    """The same JSON, in whose strings no spreadsheet finds a cell with a formula, wherever it parts the line."""
    return _STRING.sub(
        lambda match: _FORMULA.sub(lambda part: f"{part[1]}\\u{ord(part[2]):04x}", match[0]), text
    )


def _rows(columns: Sequence[Array]) -> Iterator[str]:
    """The rows of numbers; `repr` gives as many digits as it takes to read the same number back."""
    longest = max(map(len, columns))
    block = 65536
    for begin in range(0, longest, block):
        count = min(block, longest - begin)
        cells = [_cells(column[begin : begin + block], count) for column in columns]
        yield from (",".join(row) + "\n" for row in zip(*cells, strict=True))


def _cells(values: Array, count: int) -> Iterator[str]:
    return chain(map(repr, values.tolist()), repeat("", count - len(values)))


def _own(text: str, name: str) -> Recording:
    """The recording in a file of ours; raises `FormatError` where its table isn't the one that its first line describes."""
    head, _, table = text.partition("\n")
    description = metadata.from_text(head.removeprefix(_MARK), name)
    try:
        groups = [
            (bool(group["timed"]), [int(k) for k in group["channels"]], int(group["rows"]))
            for group in description["columns"]
        ]
        recording = description["recording"]
    except (TypeError, KeyError, ValueError, OverflowError):
        raise FormatError(f"{name}: its first line doesn't describe the table's layout") from None
    shapes = [(timed + len(channels), rows) for timed, channels, rows in groups]
    values = _own_table(table, shapes, name)
    samples: dict[int, tuple[Array, Array | None]] = {}
    at = 0
    for (timed, channels, rows), (width, _) in zip(groups, shapes, strict=True):
        columns = [np.ascontiguousarray(values[:rows, at + k]) for k in range(width)]
        t = columns.pop(0) if timed else None
        samples.update(zip(channels, ((column, t) for column in columns), strict=True))
        at += width
    return metadata.restore(recording, [samples[k] for k in sorted(samples)], name)


def _own_table(table: str, shapes: Sequence[tuple[int, int]], name: str) -> Array:
    """The numbers (N, M) of a table of ours; `shapes` are the columns and the rows of its groups."""
    from servobench.recordings.formats import text_table

    width, longest = sum(columns for columns, _ in shapes), max((rows for _, rows in shapes), default=0)
    lines = table.split("\n")[1:]
    if lines and not lines[-1]:
        lines.pop()
    if width == 0:
        return np.empty((0, 0))
    values, faults = text_table.numbers(lines, text_table.Layout(separator=",", decimal=".", columns=width))
    empty: dict[int, list[int]] = {}
    at = 0
    for columns, filled in shapes:
        # What the first line says of the rows may be any number; there are no more of them than lines.
        missing = list(range(filled, min(longest, len(lines))))
        empty.update({at + k: missing for k in range(columns) if missing})
        at += columns
    if len(lines) != longest or faults.rows or faults.cells != ({"cell-empty": empty} if empty else {}):
        raise FormatError(
            f"{name}: the first line describes a table of {longest} rows and {width} columns, but the file "
            "differs; if you changed it on purpose, delete that line, and the file is read as any other table"
        )
    return values

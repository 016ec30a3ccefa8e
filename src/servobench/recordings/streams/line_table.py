"""Lines of numbers as they come from a wire, made rows: a header where there is one, and what is damaged on the way counted."""

from __future__ import annotations

import math
import re

import numpy as np

from servobench.recordings.formats.columns import printable
from servobench.recordings.streams.base import Rows

_LONGEST = 4096  # bytes of a line; what is longer has lost its line ends
_MOST_COLUMNS = 100
_LABELLED = re.compile(r"([^\W\d][^:=,;\t]*)[:=](.*)")


class LineTable:
    """Turns bytes into rows: fields between commas, semicolons, tabs or blanks, also `name:value` as for a serial plotter.

    The header is the last line before the first row that has as many fields; without one the columns are column_1, column_2, ....
    A row has two columns at least; without a header two rows of one length are needed to tell. `torn` says that the first line
    may have begun before it was listened to: a row there is left out, however many fields it has.
    """

    def __init__(self, *, torn: bool = False) -> None:
        self._rest = b""
        self._torn = torn
        self._names: tuple[str, ...] = ()
        self._before: tuple[str, ...] = ()
        self._unread = ""
        self._first: tuple[str, list[float]] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the columns; empty before the first row."""
        return self._names

    def take(self, data: bytes) -> Rows:
        """Return the rows whose last byte is among `data`."""
        *lines, self._rest = (self._rest + data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
        if len(self._rest) > _LONGEST:
            lines, self._rest = [*lines, self._rest], b""
        return self._rows(lines)

    def end(self) -> Rows:
        """Return the row of the last line, which no line end follows; a part of a line it may be, so only a whole row counts."""
        rest, self._rest = self._rest, b""
        last = self._rows([rest])
        if self._first is None:
            return last
        (_, row), self._first = self._first, None
        self._names = _column_names(len(row))
        return Rows(names=self._names, values=np.array([row]), damaged=last.damaged, example=last.example)

    def _rows(self, lines: list[bytes]) -> Rows:
        all_rows: list[list[float]] = []
        damaged: list[str] = []
        for line in lines:
            text = line[:_LONGEST].decode("utf-8", "replace").strip("\ufeff\0 \t\r\n")
            if not text or text.startswith("#"):
                continue
            torn, self._torn = self._torn, False
            if torn and _is_row(text):  # or part of one, which must not decide how many columns there are
                continue
            names, fields = _fields(text)
            row = [number for each in fields if (number := _number(each)) is not None]
            if len(row) < len(fields) or not 2 <= len(row) <= _MOST_COLUMNS:
                damaged += self._other(text)
            elif self._names:
                if len(row) == len(self._names) and names in ((), self._names):
                    all_rows.append(row)
                else:
                    damaged.append(text)
            else:
                rows, lost = self._begin(text, names, row)
                all_rows += rows
                damaged += lost
        if all_rows:
            self._unread = ""
        values = np.array(all_rows, dtype=np.float64).reshape(len(all_rows), len(self._names))
        example = printable([*damaged, self._unread][0])[:60]
        return Rows(names=self._names, values=values, damaged=len(damaged), example=example)

    def _other(self, text: str) -> list[str]:
        """Take a line that is no row: a header, or damage; return the lines that are damaged."""
        header = self._header(text)
        if self._names:
            return [] if header == self._names else [text]
        self._before, self._unread = header, text
        if self._first is None or len(header) != len(self._first[1]):
            return []
        # What stood above the header was the end of a line.
        (lost, _), self._first = self._first, None
        return [lost]

    def _begin(
        self, text: str, names: tuple[str, ...], row: list[float]
    ) -> tuple[list[list[float]], list[str]]:
        """Take a row while the columns aren't known; return the rows that are known to be such, and the damaged lines.

        Without a header or names two rows of one length decide: one alone may be the end of a line, or another message.
        """
        first, self._first = self._first, None
        names = names or (self._before if len(self._before) == len(row) else ())
        alike = first is not None and len(first[1]) == len(row)
        lost = [] if first is None or (alike and not names) else [first[0]]
        if not names and not alike:
            self._first, self._unread = (text, row), text
            return [], lost
        self._names = names or _column_names(len(row))
        return ([row] if names or first is None else [first[1], row]), lost

    def _header(self, text: str) -> tuple[str, ...]:
        return tuple(each.strip("\"'") for each in _split(text))


def _column_names(count: int) -> tuple[str, ...]:
    return tuple(f"column_{k}" for k in range(1, count + 1))


def _is_row(text: str) -> bool:
    return all(_number(each) is not None for each in _fields(text)[1])


def _fields(text: str) -> tuple[tuple[str, ...], list[str]]:
    """The names in a line, where each field has one (`t:12 u:3.1`), and its fields."""
    parts = _split(text)
    labelled = [_LABELLED.fullmatch(part) for part in parts]
    if not all(labelled):
        return (), parts
    pairs = [(match[1].strip(), match[2].strip()) for match in labelled if match]
    return tuple(name for name, _ in pairs), [value for _, value in pairs]


def _split(text: str) -> list[str]:
    for mark in (";", "\t", ","):
        if mark in text:
            parts = [part.strip() for part in text.split(mark)]
            return [
                part.replace(",", ".") if mark != "," and _number(part) is None else part for part in parts
            ]
    return text.split()


def _number(text: str) -> float | None:
    """A number, not a word for one that is none: a row with `nan` tells nothing."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) and "_" not in text else None

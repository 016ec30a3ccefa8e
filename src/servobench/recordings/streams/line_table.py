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
    A row has two columns at least. `torn` says that the first line may have begun before it was listened to: a row there is left
    out, however many fields it has.
    """

    def __init__(self, *, torn: bool = False) -> None:
        self._rest = b""
        self._torn = torn
        self._names: tuple[str, ...] = ()
        self._before: tuple[str, ...] = ()
        self._unread: tuple[str, ...] = ()

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
        return self._rows([rest])

    def _rows(self, lines: list[bytes]) -> Rows:
        found: list[list[float]] = []
        damaged: list[str] = []
        for line in lines:
            text = line[:_LONGEST].decode("utf-8", "replace").strip("\ufeff\0 \t\r\n")
            if not text or text.startswith("#"):
                continue
            first, self._torn = self._torn, False
            if first and _is_row(text):  # or part of one, which must not decide how many columns there are
                continue
            row = self._row(text)
            if row is not None:
                found.append(row)
                self._unread = ()
            elif not self._names:
                self._unread = (text,)
            elif self._header(text) != self._names:
                damaged.append(text)
        width = len(self._names)
        values = np.array(found, dtype=np.float64).reshape(len(found), width)
        example = printable([*damaged, *self._unread][0])[:60] if damaged or self._unread else ""
        return Rows(names=self._names, values=values, damaged=len(damaged), example=example)

    def _row(self, text: str) -> list[float] | None:
        """The numbers in a line; None where it isn't a row. The first row decides what the columns are."""
        names, fields = _fields(text)
        numbers = [_number(each) for each in fields]
        if any(each is None for each in numbers) or not 2 <= len(numbers) <= _MOST_COLUMNS:
            if not self._names:
                self._before = self._header(text)
            return None
        if not self._names:
            plain = tuple(f"column_{k}" for k in range(1, len(numbers) + 1))
            self._names = names or (self._before if len(self._before) == len(numbers) else plain)
        if len(numbers) != len(self._names) or (names and names != self._names):
            return None
        return [each for each in numbers if each is not None]

    def _header(self, text: str) -> tuple[str, ...]:
        return tuple(each.strip("\"'") for each in _split(text))


def _is_row(text: str) -> bool:
    return all(_number(each) is not None for each in _fields(text)[1])


def _fields(text: str) -> tuple[tuple[str, ...], list[str]]:
    """The names in a line, where each field has one (`t:12 u:3.1`), and its fields."""
    parts = _split(text)
    labelled = [_LABELLED.fullmatch(part) for part in parts]
    if not all(labelled):
        return (), parts
    pairs = [(found[1].strip(), found[2].strip()) for found in labelled if found]
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

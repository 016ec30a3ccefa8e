"""Small tables as people send them: any usual separator and encoding, and cells that a spreadsheet doesn't compute."""

from __future__ import annotations

import codecs
import csv
import io
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from servobench.core.errors import FormatError

_LARGEST = 1 << 20  # bytes; a form, or a roster of thousands, has less
_SEPARATORS = (",", ";", "\t")
_FORMULA = "=+-@"
_SPREADSHEETS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # .xlsx, .ods and .numbers; .xls
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of a table: its cells by their headings in small letters, and the line of the file that it ends in."""

    cells: dict[str, str]
    line: int
    spare: int = 0
    """The number of cells beyond the headings, without empty ones at the end."""


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table: headings over its columns, and rows; `separator` stood between the cells."""

    headings: tuple[str, ...]
    rows: tuple[Row, ...]
    separator: str

    @property
    def has_decimal_commas(self) -> bool:
        """Whether a comma in a number may be its decimal mark: where a semicolon or a tabulator separates the cells."""
        return self.separator != ","


def read_table(path: Path) -> Table:
    """Return the table in a text file; empty rows are left out.

    Its first row has the headings. The encoding is what the file's first bytes say, or UTF-8, or else Windows' Latin; the
    separator is the one that stands most often in the first row. Raises `FormatError` for a file that can't be read so.
    """
    text = _decode(path)
    first = next((line for line in text.splitlines() if line.strip()), "")
    separator = max(_SEPARATORS, key=first.count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
    try:
        lines = [
            (reader.line_num, [cell.strip() for cell in row]) for row in reader if any(map(str.strip, row))
        ]
    except csv.Error as error:
        raise FormatError(f"{path}:{reader.line_num}: this is no table: {error}") from None
    if not lines:
        raise FormatError(f"{path}: it is empty")
    headings = tuple(strip_apostrophe(cell).lower() for cell in lines[0][1])
    rows = tuple(
        Row(
            cells={name: strip_apostrophe(cell) for name, cell in zip(headings, cells, strict=False)},
            line=line,
            spare=sum(any(cells[n:]) for n in range(len(headings), len(cells))),
        )
        for line, cells in lines[1:]
    )
    return Table(headings=headings, rows=rows, separator=separator)


def csv_table(rows: Sequence[Sequence[str]]) -> str:
    """Return rows as CSV, each cell such that no spreadsheet computes it."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\r\n").writerows([[harmless(cell) for cell in row] for row in rows])
    # The mark of the encoding, without which a spreadsheet takes UTF-8 for Latin.
    return "\ufeff" + text.getvalue()


def harmless(cell: str) -> str:
    """Return a text that a spreadsheet shows and doesn't compute: one that might be a formula begins with an apostrophe."""
    shown = "".join(c if c.isprintable() else " " for c in cell).strip()
    # Full-width signs count as well: some spreadsheets read them as their narrow ones.
    first = unicodedata.normalize("NFKC", shown[:1])
    return f"'{shown}" if first and first in _FORMULA and not _is_number(shown) else shown


def strip_apostrophe(cell: str) -> str:
    """Return a cell without the apostrophe that `harmless` put before it."""
    text = cell.strip()
    inner = text[1:]
    return inner if text.startswith("'") and harmless(inner) == text else text


def _is_number(text: str) -> bool:
    """Whether it is a plain number in ASCII, which a spreadsheet shows as one, such as -10.1."""
    try:
        float(text)
    except ValueError:
        return False
    return text.isascii() and "_" not in text and not text.startswith("+")


def _decode(path: Path) -> str:
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST + 1)
    except OSError as error:
        raise FormatError(f"{path}: can't be read: {error.strerror or error}") from error
    if len(data) > _LARGEST:
        raise FormatError(f"{path}: has more than {_LARGEST} bytes; expected a small table")
    if data.startswith(_SPREADSHEETS):
        raise FormatError(f"{path}: is a spreadsheet's own file; save it as CSV")
    for mark, name in _MARKS:
        if data.startswith(mark):
            return _text(data, name, path)
    if b"\0" in data:
        raise FormatError(f"{path}: is no text; expected a table as CSV")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("cp1252", "replace")


def _text(data: bytes, encoding: str, path: Path) -> str:
    try:
        return data.decode(encoding)
    except UnicodeDecodeError:
        raise FormatError(f"{path}: its first bytes say {encoding}, but it isn't; save it as UTF-8") from None

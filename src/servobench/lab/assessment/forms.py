"""The form of a student: a small table, a row for each blank, that is filled in and handed back."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from servobench.core.errors import FormatError
from servobench.lab.assessment.tables import csv_table, read_table
from servobench.lab.exercise import Blank
from servobench.lab.formula import line_text

NAME = "answers.csv"
_BLANK, _ANSWER, _CODE = "blank", "answer", "(code)"
_TABLES = (".csv", ".tsv", ".txt")
_SPREADSHEETS = (".xlsx", ".xls", ".ods", ".numbers")
_LONGEST = 100  # characters of an answer that are kept; a longer one is none
_DECIMAL_COMMA = re.compile(r"([-+−]?\d*),(\d+)(?=\D|$)")


@dataclass(frozen=True, kw_only=True)
class Form:
    """A form that was handed back: its path, the code on it (empty where it is gone), and the answers by blanks.

    `notes` are sentences on what is odd about it.
    """

    path: Path
    code: str
    answers: Mapping[str, str]
    notes: tuple[str, ...] = ()


def blank_form(blanks: Sequence[Blank], code: str) -> str:
    """Return the text of a form to fill in."""
    rows = [(_BLANK, _ANSWER, "unit", "what is asked for")]
    rows += [(blank.id, "", blank.unit, line_text(blank.label)) for blank in blanks]
    rows.append((_CODE, code, "", "says whose form this is: leave it as it is"))
    return csv_table(rows)


def read_form(path: Path) -> Form | None:
    """Return the form in a file, None where it is some other table; raises `FormatError` where it can't be read."""
    table = read_table(path)
    if _BLANK not in table.headings or _ANSWER not in table.headings:
        return None
    code, notes = "", []
    answers: dict[str, str] = {}
    for row in table.rows:
        name, answer = row.cells.get(_BLANK, "").casefold(), row.cells.get(_ANSWER, "")
        if name == _CODE:
            code = answer.casefold()
            continue
        if row.spare and answer:
            notes.append(
                f"{path.name}:{row.line}: this row has {row.spare} cell{'s' if row.spare > 1 else ''} too many, so "
                f"its answer may be only {answer[:40]!r}: was there a decimal comma? Write a point, and mark again."
            )
        if table.has_decimal_commas and "." not in answer:
            answer = _DECIMAL_COMMA.sub(r"\1.\2", answer, count=1)
        if name in answers and answers[name] != answer:
            notes.append(f"{path.name}:{row.line}: a second answer to {name[:40]!r}; the first one counts")
        answers.setdefault(name, answer if len(answer) <= _LONGEST else f"{answer[:_LONGEST]}…")
    return Form(path=path, code=code, answers=answers, notes=tuple(notes))


def forms_in(folder: Path) -> tuple[tuple[Form, ...], tuple[str, ...]]:
    """Return all forms in a folder and the folders in it, and a sentence for each file that may be one and can't be read."""
    forms, unread = [], []
    for path in _files(folder):
        if path.suffix.lower() in _SPREADSHEETS:
            unread.append(f"{path} is a spreadsheet's own file; save it as CSV and mark again")
            continue
        try:
            form = read_form(path)
        except FormatError as error:
            unread.append(str(error))
            continue
        if form is not None:
            forms.append(form)
    return tuple(forms), tuple(unread)


def _files(folder: Path) -> Iterator[Path]:
    """The files that may be forms, always in the same order; a recording's table is none, nor is what a link leads to."""
    for path in sorted(folder.rglob("*")):
        if path.suffix.lower() not in (*_TABLES, *_SPREADSHEETS) or path.is_symlink() or not path.is_file():
            continue
        if not _is_recording(path):
            yield path


def _is_recording(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(16).startswith(b"# servobench.")
    except OSError:
        return False  # reading it says why

"""Columns with many cells that aren't numbers, or without any number, and what that means if such a column has a role."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.errors import FormatError
from servobench.core.finding import Finding, Severity, info, lower_first, refusal, warning
from servobench.core.rounding import count_text
from servobench.recordings.formats.time_stamps import STAMP_FORMS, resembles_stamp
from servobench.recordings.recording import Recording, Series

_CODE = "column-not-numbers"
_NO_NAMES = "header-mismatch"
_MANY = 0.01  # of the rows; fewer damaged cells cost nothing but themselves
_HALF = 0.5
_SEPARATED = "seems to have separators between thousands: write the numbers without them"
_FEWEST = 2  # numbers, which a motion takes at least
# What programs write where they have no value says no more than an empty cell.
_NOTHING = frozenset({"-", "--", "n/a", "#n/a", "na", "null", "none", "nil", "missing"})
_GROUPED = re.compile(
    r"[+-]?[0-9]{1,3}(?:\.[0-9]{3})+,[0-9]+|[+-]?[0-9]{1,3}(?:,[0-9]{3})+(?:\.[0-9]*)?"
    r"|[+-]?[0-9]{1,3}(?:\.[0-9]{3}){2,}|[+-]?[0-9]{1,3}(?:['’ \u00a0\u202f][0-9]{3})+(?:[.,][0-9]*)?"
)


@dataclass(kw_only=True)
class Texts:
    """The `count` of cells in a column that hold a text that was meant to be a number, and the first as an `example`."""

    count: int = 0
    example: str = ""

    def add(self, text: str) -> None:
        """Count a cell; one that says that there is nothing is no damage."""
        if text.lower() not in _NOTHING:
            self.count += 1
            self.example = self.example or text


def about_columns(texts: Mapping[int, Texts], names: Sequence[str], rows: int) -> list[Finding]:
    """Return a warning for each column of a table of so many rows that has many texts, a refusal for more than half."""
    findings = []
    for c, column_texts in sorted(texts.items()):
        if column_texts.count <= _MANY * rows:
            continue
        sentence = (
            f"{_begin(names[c])} has {column_texts.count} cells of {rows} that aren't numbers, such as "
            f"{column_texts.example[:40]!r}"
        )
        if _GROUPED.fullmatch(column_texts.example):
            sentence += f", which {_SEPARATED}."
        else:
            sentence += ": they are left out. Correct them in the file, or export it again."
        findings.append((refusal if column_texts.count > _HALF * rows else warning)(_CODE, sentence))
    return findings


def about_words(name: str, example: str) -> Finding:
    """Return the finding on a column whose cells are texts, such as the `example`, and none a number."""
    forms = f"; {STAMP_FORMS}" if resembles_stamp(example) else ""
    if _GROUPED.fullmatch(example):
        forms = f"; it {_SEPARATED}"
    return info(
        "column-skipped", f"{_name(name)} holds text, such as {example[:40]!r}, and no number{forms}."
    )


def has_numbers(series: Series) -> bool:
    """Return whether a channel can have a role: a column of words, or of empty cells, has samples but no number."""
    return not len(series.values) or bool(np.isfinite(series.values).any())


def check_readable(recording: Recording, series: Series, role: str) -> None:
    """Raise `FormatError` where a channel that has a role, `time` included, has cells, but fewer than two numbers."""
    cells, numbers = len(series.values), int(np.isfinite(series.values).sum())
    if cells < _FEWEST or numbers >= _FEWEST:
        return
    name = series.channel.name
    plain = f"`{name}` has {count_text(numbers, 'number')} in {count_text(cells, 'row')}; at least two are needed."
    about = (
        each.sentence
        for each in recording.findings
        if each.sentence.startswith((_begin(name), f"{_name(name)} holds"))
    )
    raise FormatError(
        f"{recording.name}: the {role} can't be read: {lower_first(next(about, plain))} If another column is the {role}, say "
        f"`{role}=COL:UNIT`"
    )


def demote_unused(findings: Iterable[Finding], used: Iterable[str]) -> list[Finding]:
    """Return findings; those on unused columns (others than `used`) are only information, and those on names not used.

    Nothing is recognised without names, so that each column was said by its number.
    """
    begins = tuple(map(_begin, used))
    return [
        replace(each, severity=Severity.INFO)
        if (each.code == _CODE and not each.sentence.startswith(begins)) or each.code == _NO_NAMES
        else each
        for each in findings
    ]


def _begin(name: str) -> str:
    """The words that a sentence on a column begins with, which tell it from all others."""
    return f"The column {_name(name)}"


def _name(name: str) -> str:
    return f"`{name}`"

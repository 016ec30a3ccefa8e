"""Columns of a text table with many cells that aren't numbers, and what that means if such a column has a role."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from servobench.core.finding import Finding, Severity, refusal, warning

_CODE = "column-not-numbers"
_NO_NAMES = "header-mismatch"
_MANY = 0.01  # of the rows; fewer damaged cells cost nothing but themselves
_HALF = 0.5
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
            sentence += ", which seems to have separators between thousands: write the numbers without them."
        else:
            sentence += ": they are left out. Correct them in the file, or export it again."
        findings.append((refusal if column_texts.count > _HALF * rows else warning)(_CODE, sentence))
    return findings


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
    return f"The column `{name}`"

"""Columns from the names of files: `{line}/{serial}_{date}.csv`."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

from servobench.core.errors import UsageError
from servobench.core.parameter_names import PARAMETER_NAMES

_PIECE = re.compile(r"\{(?P<field>[^{}]*)\}|(?P<any>\*\*/?|\*)|(?P<text>[^{}*]+)|(?P<stray>[{}])")
_FIELD = re.compile(r"[a-z][a-z0-9_]*")
_ENDINGS = ("", "_sd", "_low", "_high", "_unit", "_state")


@dataclass(frozen=True)
class NamePattern:
    """A pattern for the path of a recording below its source, with `/` between folders.

    `{serial}` is one or more characters of one folder's or file's name and becomes the column `serial`; where several readings
    are possible, an earlier field takes as little as it can. `*` is any part of a name, `**/` any folders. Raises `UsageError`
    for a text that is no pattern.

    >>> NamePattern("{line}/{serial}_{date}.csv").columns("A/17_2026-11-23.csv")
    {'line': 'A', 'serial': '17', 'date': '2026-11-23'}
    """

    text: str

    def __post_init__(self) -> None:
        _ = self._expression

    @property
    def names(self) -> tuple[str, ...]:
        """The columns, in their order."""
        return tuple(self._expression.groupindex)

    def columns(self, path: str) -> dict[str, str] | None:
        """Return the value of each column for a path, None where the path doesn't match."""
        match = self._expression.fullmatch(path)
        return match.groupdict() if match else None

    @cached_property
    def _expression(self) -> re.Pattern[str]:
        parts: list[str] = []
        names: list[str] = []
        for piece in _PIECE.finditer(self.text):
            name, anything, text = piece["field"], piece["any"], piece["text"]
            if piece["stray"]:
                raise UsageError(
                    f"`pattern={self.text}`: a brace isn't closed, or wasn't opened; write {{serial}}"
                )
            if name is not None:
                self._check(name, names)
                names.append(name)
                parts.append(f"(?P<{name}>[^/]+?)")
            elif anything:
                parts.append({"*": "[^/]*", "**": ".*", "**/": "(?:[^/]+/)*"}[anything])
            else:
                parts.append(re.escape(text))
        if not names:
            raise UsageError(
                f"`pattern={self.text}` has no field; put what varies in the names into braces, such as "
                "'{serial}_{date}.csv'"
            )
        return re.compile("".join(parts), re.DOTALL)

    def _check(self, name: str, before: list[str]) -> None:
        """Raise `UsageError` for a field that can't be a column."""
        if not _FIELD.fullmatch(name):
            raise UsageError(
                f"`pattern={self.text}`: {{{name}}} can't be a column; use small letters, digits and _, such as {{serial}}"
            )
        if name in before:
            raise UsageError(
                f"`pattern={self.text}`: {{{name}}} occurs in it twice; give each field its own name"
            )
        if name in RESERVED or any(
            name.endswith(ending) and name.removesuffix(ending) in PARAMETER_NAMES for ending in _ENDINGS
        ):
            raise UsageError(
                f"`pattern={self.text}`: the table has a column {name} already; give the field another name"
            )


RESERVED = frozenset({
    "file", "outcome", "verdict", "reason", "structure", "estimator", "findings", "sentences", "budget", "good_for",
    "fit_percent", "validation_percent", "samples", "duration", "sample_time", "sha256", "stamp", "cpu_seconds", "version",
    "decision", "decided_by", "rule", "consumer_risk", "producer_risk", "distance", "outlier",
})  # fmt: skip
"""The columns that every table has."""

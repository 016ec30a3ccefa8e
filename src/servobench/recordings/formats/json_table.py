"""Tables in JSON: a list of objects, one for each sample, an object of lists, one for each column, or an object a line.

`[{"t": 0.0, "u": 1.5}, ...]`, `{"t": [0.0, 0.01, ...], "u": [1.5, 1.5, ...]}`, or either as the only table in an object.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, NoReturn, final

import numpy as np

from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding, info
from servobench.recordings.cells import mostly_numbers
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.columns import (
    LARGEST_TABLE,
    Column,
    heading,
    printable,
    quote,
    recording_of,
)
from servobench.recordings.formats.servo_bench_json import ServoBenchJson
from servobench.recordings.formats.sysid_json import SysIdJson
from servobench.recordings.formats.times import in_words
from servobench.recordings.recording import Recording, Source

_OBJECTS = re.compile(r'\s*\[\s*\{\s*"')
_COLUMN = re.compile(r'\s*\{[^{}]*"\s*:\s*\[\s*-?[0-9]')
_LINE = re.compile(r'\s*\{\s*"[^{}\[\]]*:\s*-?[0-9][^{}\[\]]*\}\s*\n\s*\{')

_FEWEST_ROWS = 10  # of a table within an object

_Columns = Mapping[str, Sequence[Any]]


@final
@FORMATS.member("json_table")
@dataclass(frozen=True, kw_only=True)
class JsonTable:
    """A table in JSON: one recording. It is read and not written."""

    suffixes: ClassVar[tuple[str, ...]] = (".json", ".jsonl", ".ndjson")
    written: ClassVar[tuple[str, ...]] = ()
    by_library: ClassVar[bool] = False

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a list of JSON objects, or an object of lists of numbers."""
        if ServoBenchJson().recognises(path, head) or SysIdJson().recognises(path, head):
            return False
        text = head.decode("utf-8-sig", "replace")
        return any(begin.match(text) for begin in (_OBJECTS, _COLUMN, _LINE))

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recording; raises `FormatError` where there is no table, or more than one."""
        content = _content(path)
        columns = _table_in(content)
        if columns is None:
            raise FormatError(
                f"{path.name} is JSON, but not a table: it has {_summary(content)}. Expected a list of objects such as "
                '[{"t": 0, "u": 1.5}, ...], an object of equally long lists, or a file of SysId or a servo bench'
            )
        return (_recording(columns, content, path),)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> NoReturn:
        """Raise `UsageError`: a table in JSON can't hold what a recording knows."""
        raise UsageError(f"{path.name}: tables in JSON can't be written; write .mcap, .mat or .csv instead")


def _content(path: Path) -> Any:
    """What the JSON of a file holds; a list where each line is an object of its own."""
    data = path.read_bytes()
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as error:
        try:
            lines = [json.loads(line) for line in data.splitlines() if line.strip()]
        except (ValueError, RecursionError):
            lines = []
        if len(lines) > 1:
            return lines
        raise FormatError(f"{path.name} isn't JSON, or is damaged: {error}") from None


def _table_in(content: Any) -> _Columns | None:
    """The columns of the only table in what JSON holds; None where there is none, or more than one."""
    columns = _columns(content)
    if columns is not None or not isinstance(content, dict):
        return columns
    tables = [each for value in content.values() if (each := _columns(value)) is not None and _is_long(each)]
    return tables[0] if len(tables) == 1 else None


def _is_long(columns: _Columns) -> bool:
    """Whether a table within an object can be a recording, and none of settings or results."""
    numbers = [cells for cells in columns.values() if _has_numbers(cells)]
    return len(numbers) > 1 and len(numbers[0]) >= _FEWEST_ROWS


def _columns(value: Any) -> _Columns | None:
    """The columns by name where a value is a list of objects, or an object of equally long lists."""
    if isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
        names = dict.fromkeys(name for each in value for name in each)
        return (
            {name: [each.get(name) for each in value] for name in names}
            if len(names) <= LARGEST_TABLE
            else None
        )
    if not isinstance(value, dict):
        return None
    lists = {name: each for name, each in value.items() if isinstance(each, list) and _has_numbers(each)}
    lengths = {len(each) for each in lists.values()}
    return lists if len(lengths) == 1 and len(lists) <= LARGEST_TABLE else None


def _has_numbers(values: Sequence[Any]) -> bool:
    return any(isinstance(each, int | float) for each in values)


def _recording(columns: _Columns, content: Any, path: Path) -> Recording:
    findings: list[Finding] = []
    parts, skipped = [], []
    for name, cells in columns.items():
        values, texts = mostly_numbers(np.fromiter(cells, dtype=object, count=len(cells)))
        if values is None or not _has_numbers(cells):
            skipped.append(name)
            continue
        if texts:
            findings.append(_about_texts(name, texts))
        parts.append(Column(heading=heading(name), values=values))
    if not parts:
        raise FormatError(f"{path.name} has no column of numbers, only {quote(skipped) or 'empty objects'}")
    if isinstance(content, dict):
        skipped += [name for name, value in content.items() if name not in columns and value is not None]
    if skipped:
        findings.append(
            info("columns-not-numbers", f"Columns that aren't numbers aren't read: {quote(skipped)}.")
        )
    source = Source(name=path.name, format="json_table")
    return recording_of(parts, name=path.stem, source=source, findings=findings)


def _about_texts(name: str, texts: Mapping[int, str]) -> Finding:
    example = printable(next(iter(texts.values())))[:40]
    rows = in_words(np.array(list(texts), dtype=np.int64) + 1, "sample")
    sentence = (
        f"Text where a number should be, such as {example!r}, read as NaN: {rows}, in `{printable(name)}`."
    )
    return info("cell-not-a-number", sentence)


def _summary(content: Any) -> str:
    """What JSON holds, in a few words."""
    if isinstance(content, dict):
        return quote(content) or "nothing"
    if isinstance(content, list):
        kinds = sorted({"an object" if isinstance(each, dict) else type(each).__name__ for each in content})
        return f"a list of {len(content)} ({', '.join(kinds)})" if kinds else "an empty list"
    return f"a single {type(content).__name__}"

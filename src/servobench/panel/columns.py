"""The roles of an imported file's columns: questions to the user, and the answers, kept as the recording's mapping."""

from __future__ import annotations

import math
from collections.abc import Mapping as Given
from dataclasses import fields
from pathlib import Path
from typing import Any

from servobench.core.errors import UnknownName, UsageError
from servobench.panel.library import MAPPING
from servobench.recordings.formats.columns import TIME_NAMES, heading
from servobench.recordings.formats.describe import describe
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.formats.roles import ColumnSpec, plain_name
from servobench.recordings.formats.timing import seconds
from servobench.recordings.formats.unreadable import has_numbers
from servobench.recordings.recording import Recording, Series

QUESTIONS = "columns.json"
_FIRST = 5  # values of a column that are shown
_LONGEST = 500  # letters of an answer
_NEEDED = {"input": "what drives the motor", "output": "what was measured on the motor"}


def questions(recording: Recording) -> dict[str, Any]:
    """Return, as JSON can hold it, what a form asks about a recording, filled in with what is known.

    `open` says that it can't be identified before that is answered: roles, units or times aren't known, or the unit of the time
    stands nowhere. `time`, `input`, `output` have a `column` and a `unit`, None where they aren't known; `own_times` says that
    the samples have times without a column for them.
    """
    described = describe(recording)
    known = described.mapping
    time = _time(recording, known.time)
    own_times = known.time is None and any(each.t is not None for each in recording.series)
    unsure = time["unit"] is None and not own_times
    return {
        "open": bool(described.missing) or unsure,
        "columns": [_column(each) for each in recording.series],
        "own_times": own_times,
        "time": time,
        "input": _role(recording, known.input),
        "output": _role(recording, known.output),
        "chain": known.chain,
    }


def mapping_of(answers: Given[str, Any]) -> Mapping:
    """Return the mapping that a person's answers are; raises `UsageError` for what is none, or what isn't answered."""
    known = [each.name for each in fields(Mapping) if each.name not in ("recordings", "each")]
    for name, value in answers.items():
        if name not in known:
            raise UnknownName("answer about a file's columns", str(name)[:80], known)
        if not isinstance(value, str) or len(value) > _LONGEST:
            raise UsageError(f"the answer about {name} must be a text of at most {_LONGEST} letters")
    entries: dict[str, Any] = {name: value.strip() for name, value in answers.items() if value.strip()}
    for role, meaning in _NEEDED.items():
        if role not in entries:
            raise UsageError(f"the {role} is missing: choose the column that is {meaning}, and its unit")
    for role in ("time", *_NEEDED):
        if role in entries and ColumnSpec.parse(entries[role]).unit is None:
            raise UsageError(f"the unit of the {role} is missing: choose the unit of its values")
    if "sample_time" in entries:
        entries["sample_time"] = seconds(entries["sample_time"])
    return Mapping(**entries)


def apply_mapping(recording: Recording, folder: Path) -> Recording:
    """Return a recording as the mapping in its folder says; as it is where there is none."""
    file = folder / MAPPING
    return Mapping.read(file).assign_to(recording) if file.is_file() else recording


def _column(series: Series) -> dict[str, Any]:
    return {
        "name": series.channel.name,
        "unit": series.channel.unit,
        "samples": len(series.values),
        "first": [float(each) if math.isfinite(each) else None for each in series.values[:_FIRST]],
    }


def _time(recording: Recording, known: str | None) -> dict[str, str | None]:
    """The column of the times, and its unit where the file itself says one: what is usual may be wrong by a thousand."""
    named = [
        each.channel
        for each in recording.series
        if plain_name(each.channel.name) in TIME_NAMES and has_numbers(each)
    ]
    if known is not None:
        column = ColumnSpec.parse(known).column
        named = [each.channel for each in recording.series if each.channel.name == column]
    if len(named) != 1:
        return {"column": None, "unit": None}
    return {"column": named[0].name, "unit": named[0].unit or heading(named[0].name).unit}


def _role(recording: Recording, known: str | None) -> dict[str, str | None]:
    if known is None:
        return {"column": None, "unit": None}
    spec = ColumnSpec(column=known) if known in recording else ColumnSpec.parse(known)
    return {"column": spec.column, "unit": spec.unit or recording[spec.column].channel.unit}

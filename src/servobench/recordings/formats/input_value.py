"""An input that no column holds: one value throughout a recording, from the lab book or from the file's name."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from servobench.core.channels import Channel
from servobench.core.errors import UsageError
from servobench.core.finding import info
from servobench.core.units import is_unit
from servobench.recordings.formats.roles import ColumnSpec, full_scale
from servobench.recordings.recording import Recording, Series

LEVEL = "{level}"
"""The placeholder for the value in a pattern of a file's name."""
CHANNEL = "input_value"
"""The name of the channel that is made of it."""

_NUMBER = r"[-+]?(?:[0-9]+(?:[.,][0-9]+)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_VALUE = re.compile(rf"\s*(?P<number>{_NUMBER})\s*:?\s*(?P<unit>\S.*?)?\s*")


def is_pattern(text: object) -> bool:
    """Return whether what is given for a column is a pattern of a file's name."""
    return isinstance(text, str) and LEVEL in text


def with_input_value(recording: Recording, text: str) -> Recording:
    """Return the recording with a channel of that value, such as `50:%` or `7 V`, as its input.

    Raises `UsageError` for a text that isn't a number with a unit.
    """
    match = _VALUE.fullmatch(text)
    if match is None or not _is_input_unit(match["unit"]):
        raise UsageError(
            f"`input_value={text}`: expected a number with a unit, such as 50:%, 7:V or 128:PWM/255"
        )
    return _with_constant(recording, _number(match["number"]), match["unit"], "as stated")


def with_input_of_name(recording: Recording, pattern: str) -> Recording:
    """Return the recording with a channel of the value that its file's name has in the place of `{level}`, as its input.

    `{level}pwr:%` is 50 % for `motor_50pwr.txt`. What stands between the letters around has to be there. Raises `UsageError` for
    a pattern without a unit, and where the name has no such value, or several.
    """
    spec = ColumnSpec.parse(pattern)
    if spec.column.count(LEVEL) != 1 or not _is_input_unit(spec.unit):
        raise UsageError(
            f"`input={pattern}`: expected {LEVEL} once, and a unit after the pattern, such as {LEVEL}pwr:%"
        )
    name = PurePath(recording.source.name).name
    before, after = map(re.escape, spec.column.split(LEVEL))
    levels = {_number(each) for each in re.findall(rf"(?<![0-9]){before}({_NUMBER}){after}(?![0-9])", name)}
    if len(levels) != 1:
        has = f"several: {', '.join(f'{each:g}' for each in sorted(levels))}" if levels else "none"
        raise UsageError(
            f"`input={pattern}`: the name {name!r} has {has}; give more of the letters around the value, or `input_value=...`"
        )
    return _with_constant(recording, levels.pop(), str(spec.unit), f"as its file's name {name!r} says")


def _with_constant(recording: Recording, value: float, unit: str, why: str) -> Recording:
    if CHANNEL in recording:
        raise UsageError(
            f"{recording.name} has a channel {CHANNEL!r} already; rename it, or name it as the input"
        )
    longest = max(recording.series, key=lambda each: len(each.values), default=None)
    if longest is None:
        raise UsageError(f"{recording.name} has no channel besides its input")
    series = Series(
        channel=Channel(name=CHANNEL, unit=unit), values=np.full(len(longest.values), value), t=longest.t
    )
    sentence = f"The input is {value:g} {unit} throughout, {why}."
    changed = replace(recording, series=(*recording.series, series), input=CHANNEL)
    return changed.with_findings(info("input-stated", sentence))


def _is_input_unit(symbol: str | None) -> bool:
    return symbol is not None and (is_unit(symbol) or full_scale(symbol) is not None)


def _number(text: str) -> float:
    value = float(text.replace(",", "."))
    if not math.isfinite(value):
        raise UsageError(f"an input of {text} is too large")
    return value

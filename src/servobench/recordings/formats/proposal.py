"""A mapping as a file to edit: recognised entries are filled in, unknown ones are questions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import wrap

from servobench.recordings.formats.clock_columns import clock_columns
from servobench.recordings.formats.columns import TIME_NAMES
from servobench.recordings.formats.describe import Description, describe
from servobench.recordings.formats.mapping import toml_value
from servobench.recordings.formats.roles import (
    REFERENCE_NAMES,
    ColumnSpec,
    Role,
    may_be_supply,
    plain_name,
    quantity_of,
    recognise,
)
from servobench.recordings.formats.unreadable import has_numbers
from servobench.recordings.recording import Recording

_WIDTH = 110
_MOST_COLUMNS = 40
_WANTED = {"input": {"voltage", "duty"}, "output": {"position", "speed"}}


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """A key of the mapping: its purpose, and its value if known, otherwise values to choose from."""

    key: str
    comment: str
    value: object = None
    choices: tuple[object, ...] = ()

    def lines(self) -> list[str]:
        """The entry as lines of TOML, the explanation before it."""
        if self.value is not None:
            return [*_comment(self.comment), f"{self.key} = {toml_value(self.value)}", ""]
        return [
            *_comment(self.comment),
            *(f"# {self.key} = {toml_value(choice)}" for choice in self.choices),
            "",
        ]


def proposal(
    recordings: Sequence[Recording], command: str = "servobench identify FILE --mapping THIS.toml"
) -> str:
    """Return the text of a mapping file for the recordings of a file.

    What is known or recognised is set. What isn't stands there as a comment with a question and with what may be meant; who
    edits it takes the `#` away. Recordings that differ in that have a table each. `command` is how the file is used.
    """
    described = [describe(recording) for recording in recordings]
    entries = [_entries(recording, each) for recording, each in zip(recordings, described, strict=True)]
    names = tuple(recording.name for recording in recordings)
    lines = [*_head(recordings[0], command)]
    if len(names) > 1:
        lines += [
            *_comment("The recordings to use; remove the others."),
            f"recordings = {toml_value(names)}",
            "",
        ]
    if all(each == entries[0] for each in entries):
        lines += [*_columns(described[0]), *(line for entry in entries[0] for line in entry.lines())]
        return "\n".join(lines)
    for name, each, own in zip(names, described, entries, strict=True):
        lines += [f"[recording.{toml_value(name)}]", *_columns(each)]
        lines += [line for entry in own for line in entry.lines()]
    return "\n".join(lines)


def _head(recording: Recording, command: str) -> list[str]:
    source = recording.source
    return [
        *_comment(f"The columns of {source.name} ({source.format}), as far as they were recognised."),
        *_comment(f"Edit it, then use it: {command}"),
        *_comment(
            "Lines that begin with # are comments: remove the # where a line is right, and fill in what is missing. "
            "COL is a column's name, or its number counted from 1; UNIT is, for example, V, %, rad, deg/s, rpm, "
            "counts."
        ),
        "",
    ]


def _columns(description: Description) -> list[str]:
    """The columns with their ranges, as comments."""
    shown = description.channels[:_MOST_COLUMNS]
    lines = ["# The columns, with the range of their values:"]
    for number, each in enumerate(shown, 1):
        low, high = (f"{end:.6g}" if end is not None else "-" for end in (each.minimum, each.maximum))
        lines += _comment(
            f"  {number}. {each.name} [{each.unit or '?'}]: {each.samples} samples, {low} to {high}"
        )
    if len(description.channels) > len(shown):
        lines.append(f"#   and {len(description.channels) - len(shown)} more")
    return [*lines, ""]


def _entries(recording: Recording, description: Description) -> list[_Entry]:
    known = description.mapping
    entries = _time(recording, known.time)
    for role in ("input", "output"):
        entries.append(_role(recording, role, known.input if role == "input" else known.output))
    entries += [
        _supply(recording),
        _reference(recording),
        _current(recording),
        *_turn(recording, known.output),
        _chain(recording, known.output),
    ]
    return entries


def _time(recording: Recording, known: str | None) -> list[_Entry]:
    if known is not None:
        return [_Entry(key="time", comment="The times of the samples.", value=known)]
    if any(series.t is not None for series in recording.series):
        question = (
            "The times come with the samples. If they are wrong, give a column with its unit, or the time "
            "between samples."
        )
    else:
        question = "No time column was recognised: name one, or give the time between samples."
    named = tuple(f"{name}:s" for name in _names(recording) if plain_name(name) in TIME_NAMES)
    return [
        _Entry(key="time", comment=question, choices=named or ("COL:s",)),
        _Entry(
            key="sample_time",
            comment="Or, for evenly spaced samples, instead of a column:",
            choices=(_sample_time(recording),),
        ),
    ]


def _sample_time(recording: Recording) -> str:
    """The sample time that a column of rounded times or of time steps shows, or a place for it."""
    steps = [each.steps[0].figure for each in clock_columns(recording) if len(each.steps) == 1]
    return f"{steps[0]:.6g} s" if len(steps) == 1 else "SECONDS"


def _role(recording: Recording, role: Role, known: str | None) -> _Entry:
    what = "What drives the motor" if role == "input" else "What was measured of the motor"
    how = "V or %" if role == "input" else "a position or a speed"
    if known is not None:
        unit = ColumnSpec.parse(known).unit or _unit(recording, known)
        if unit is not None:
            return _Entry(key=role, comment=f"{what}, in its unit ({how}).", value=known)
        return _Entry(key=role, comment=f"{what}: what is the unit of `{known}`?", choices=(f"{known}:UNIT",))
    candidates = [each.name for each in recognise(recording, role)] or _channels_of(recording, _WANTED[role])
    choices = tuple(_column_text(recording, name) for name in candidates) or ("COL:UNIT",)
    return _Entry(key=role, comment=f"{what}, in its unit ({how}): which column is it?", choices=choices)


def _supply(recording: Recording) -> _Entry:
    named = [name for name in _names(recording) if may_be_supply(name)]
    question = (
        "If the input is a duty: the supply voltage, as a column or a constant; the motor's voltage is their "
        "product. Raw counts of a pulse width are a duty in the unit PWM/255, or whatever 100 % is."
    )
    return _Entry(
        key="supply",
        comment=question,
        choices=tuple(_column_text(recording, name) for name in named) or ("12 V",),
    )


def _reference(recording: Recording) -> _Entry:
    named = [name for name in _names(recording) if plain_name(name) in REFERENCE_NAMES]
    question = "In a closed loop, the reference of the loop."
    if recording.reference is not None:
        return _Entry(key="reference", comment=question, value=_column_text(recording, recording.reference))
    return _Entry(
        key="reference",
        comment=question,
        choices=tuple(_column_text(recording, name) for name in named) or ("COL:UNIT",),
    )


def _current(recording: Recording) -> _Entry:
    question = "The measured current of the armature, which separates resistance and torque constant."
    named = _channels_of(recording, {"current"})
    return _Entry(
        key="current",
        comment=question,
        choices=tuple(_column_text(recording, name) for name in named) or ("COL:A",),
    )


def _turn(recording: Recording, output: str | None) -> list[_Entry]:
    """The question for the counts per turn, if the output is in counts and they aren't known."""
    if output is None:
        return []
    spec = ColumnSpec.parse(output)
    known = spec.column in recording and recording[spec.column].channel.counts_per_rev is not None
    if known or (spec.unit or _unit(recording, output)) not in ("counts", "counts/s"):
        return []
    question = "How many counts make a turn of the shaft? Without an answer, the result is in counts."
    return [_Entry(key="counts_per_rev", comment=question, choices=(2048,))]


def _chain(recording: Recording, output: str | None) -> _Entry:
    if recording.chain:
        return _Entry(
            key="chain", comment="What lies between the shaft and the output.", value=recording.chain
        )
    unit = (ColumnSpec.parse(output).unit or _unit(recording, output)) if output else None
    question = "What lies between the shaft and the output: stages, a device that `servobench chains` lists, or none."
    if quantity_of(unit) == "speed":
        question += " How was this speed measured? Without an answer, a filter's lag counts as the motor's."
    return _Entry(
        key="chain", comment=question, choices=("none", "derivative | lowpass 50 rad/s", "talon-srx")
    )


def _names(recording: Recording) -> list[str]:
    """The channels that can have a role."""
    return [series.channel.name for series in recording.series if has_numbers(series)]


def _channels_of(recording: Recording, quantities: set[str]) -> list[str]:
    """The channels that measure one of some quantities, without those that are asked about as something else."""
    names = [name for name in _names(recording) if quantity_of(_unit(recording, name)) in quantities]
    return [name for name in names if plain_name(name) not in REFERENCE_NAMES and not may_be_supply(name)]


def _unit(recording: Recording, name: str) -> str | None:
    return recording[name].channel.unit if name in recording else None


def _column_text(recording: Recording, name: str) -> str:
    """A column as it is said, with a place for its unit where that isn't known."""
    return str(ColumnSpec(column=name, unit=recording[name].channel.unit or "UNIT"))


def _comment(text: str) -> list[str]:
    """A text as comments; what can't stand in one, such as a control character, is replaced."""
    clean = "".join(letter if letter.isprintable() else "?" for letter in text)
    indent = " " * (len(clean) - len(clean.lstrip()))
    lines = wrap(clean.strip(), _WIDTH, break_long_words=False, break_on_hyphens=False)
    return [f"# {indent}{line}".rstrip() for line in lines] or ["#"]

"""The meaning and the unit of each column of a file.

A recognised name is a finding and not a silent choice. All missing information is requested at once.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from servobench.core import toml
from servobench.core.errors import MissingInformation, UnknownName, UsageError
from servobench.core.finding import Finding, info
from servobench.core.units import unit
from servobench.recordings.formats.choice import Choice, about_other_roles, about_two_motors, choose, spec_of
from servobench.recordings.formats.direction import missing_sign
from servobench.recordings.formats.input_value import is_pattern, with_input_of_name, with_input_value
from servobench.recordings.formats.likely_units import about_input_unit
from servobench.recordings.formats.position_beside import about_position_beside
from servobench.recordings.formats.roles import ARMATURE_CURRENT, ColumnSpec, Role, quantity_of, shell_text
from servobench.recordings.formats.supply import constant, motor_voltage
from servobench.recordings.formats.timing import assign_times, seconds
from servobench.recordings.formats.unreadable import demote_unused
from servobench.recordings.formats.usable import usable
from servobench.recordings.recording import Recording, Series


def assign(
    recording: Recording,
    *,
    time: str | ColumnSpec | None = None,
    input: str | ColumnSpec | None = None,
    output: str | ColumnSpec | None = None,
    reference: str | ColumnSpec | None = None,
    supply: str | ColumnSpec | None = None,
    current: str | ColumnSpec | None = None,
    sample_time: float | str | None = None,
    counts_per_rev: float | None = None,
    chain: str = "",
    input_value: str | None = None,
) -> Recording:
    """Return the recording with input and output set, both with unit and times.

    What is given comes first, then what the recording knows itself, then what its names say; `u` and `voltage` are taken as V
    and `t` and `time` as s where nobody says otherwise. `sample_time` [s] makes times k·sample_time for samples without any, or
    instead of the file's. `counts_per_rev` is what an output in counts has in one turn of the shaft, edges of both channels
    included: the result is then in rad. Samples of the two channels whose time doesn't increase, or that have no finite value,
    are left out, with a finding. `chain` is the text of what lies between the shaft and the output.
    `reference` is what a feedback loop was told to follow. `supply` is what feeds the amplifier of an input that is a duty: a
    channel, or a constant such as `7.4 V`; the input is then their product in V, a new channel. `current` is the measured current
    of the armature, which is then called `armature_current`. `input_value` is an input that no column holds, such as `50:%`; an
    `input` such as `{level}pwr:%` is what the file's name has in that place.
    Raises `MissingInformation` with a sentence for each thing that has to be said, `UnknownName` for a column that isn't there,
    `FormatError` for times that can't be used, and `UsageError` for what can't be so.
    """
    if time is not None and sample_time is not None:
        raise UsageError(
            f"both a time column ({time}) and a sample time ({sample_time}) are given; give one of them"
        )
    if input_value is not None:
        if input is not None:
            raise UsageError(
                f"both `input={input}` and `input_value={input_value}` are given; give one of them"
            )
        recording = with_input_value(recording, input_value)
    elif isinstance(input, str) and is_pattern(input) and ColumnSpec.parse(input).column not in recording:
        recording, input = with_input_of_name(recording, input), None
    volts = constant(supply, recording)
    columns: dict[Role, str | ColumnSpec | None] = {"input": input, "output": output}
    columns |= {"reference": reference} if reference is not None else {}
    columns |= {"supply": supply} if supply is not None and volts is None else {}
    columns |= {"current": current} if current is not None else {}
    roles, before = _choose_and_time(
        recording, columns, spec_of(time, recording), sample_time, counts_per_rev is not None
    )
    taken, about_samples = usable(recording.name, {role: roles.series[role] for role in ("input", "output")})
    reference_name = roles.name("reference") or recording.reference
    stated: dict[Role, object] = {"reference": reference_name, "supply": supply}
    used = [each.channel.name for each in roles.series.values()]
    known = [role for role, what in stated.items() if what is not None]
    result = replace(
        recording,
        series=_merge(recording.series, [*roles.others, *taken.values()]),
        input=taken["input"].channel.name,
        output=taken["output"].channel.name,
        reference=reference_name,
        chain=chain.strip() or recording.chain,
        findings=(
            *before,
            *roles.findings,
            *about_samples,
            *about_other_roles(recording, taken["input"], used, known),
            *about_two_motors(recording, *(taken[role].channel.name for role in ("input", "output"))),
            *about_position_beside(recording, taken["output"]),
        ),
    )
    result = _with_unit_doubt(result, recording)
    if counts_per_rev is not None:
        result = _with_turn(result, counts_per_rev)
    if roles.is_scaled:  # what was before is in another unit
        result = replace(result, input_before=None)
    return result if supply is None else motor_voltage(result, roles.series.get("supply"), volts)


def _with_unit_doubt(result: Recording, recording: Recording) -> Recording:
    """The result with a doubt of the input's unit, where its name or its values contradict it; `recording` is as it was read."""
    driven = result[str(result.input)]
    name = driven.channel.name
    from_file = name in recording and quantity_of(recording[name].channel.unit) == "voltage"
    return replace(result, findings=(*result.findings, *about_input_unit(driven, from_file)))


def _with_turn(recording: Recording, counts_per_rev: float) -> Recording:
    """The recording whose output knows how many counts make a turn; raises `UsageError` where it is in no counts."""
    series = recording[str(recording.output)]
    name, symbol = series.channel.name, series.channel.unit or ""
    if unit(symbol).si not in {"counts", "counts/s"}:
        raise UsageError(
            f"{counts_per_rev:g} counts per turn are given, but the output `{name}` is in {symbol}; say "
            f"`output={name}:counts` if it holds counts, otherwise leave `counts_per_rev=...` out"
        )
    channel = replace(series.channel, counts_per_rev=counts_per_rev)
    return replace(recording, series=_merge(recording.series, [replace(series, channel=channel)]))


@dataclass(frozen=True, kw_only=True)
class _Roles:
    """The series that have a role, with times, and what is to be known of them."""

    series: dict[Role, Series]
    findings: tuple[Finding, ...]

    @property
    def others(self) -> list[Series]:
        """The series of other roles than input and output."""
        return [each for role, each in self.series.items() if role not in ("input", "output")]

    @property
    def is_scaled(self) -> bool:
        """Whether the input's values are no longer the recording's."""
        return any(finding.code == "duty-scaled" for finding in self.findings)

    def name(self, role: Role) -> str | None:
        """The name of the channel that has a role, None where there is none."""
        return self.series[role].channel.name if role in self.series else None


def _choose_and_time(
    recording: Recording,
    columns: dict[Role, str | ColumnSpec | None],
    time: ColumnSpec | None,
    sample_time: float | str | None,
    in_counts: bool,
) -> tuple[_Roles, list[Finding]]:
    """The series of the roles, and the findings of the recording that still hold; raises `MissingInformation`.

    An output without a unit is `in_counts` where the counts per turn are given.
    """
    missing: list[str] = []
    parts: dict[Role, Choice] = {}
    for role, column in columns.items():
        taken = [each.series.channel.name for each in parts.values()]
        part = choose(recording, role, spec_of(column, recording), taken, in_counts and role == "output")
        if isinstance(part, str):
            missing.append(part)
        else:
            parts[role] = part
    series = {role: part.series for role, part in parts.items()}
    if {"input", "output"} <= series.keys():
        name, sign = series["input"].channel.name, missing_sign(recording, series["input"], series["output"])
        if sign and sign != name:
            missing.append(
                f"the sign of the input `{name}`: it is never negative, but the shaft turns both ways, as `{sign}` says; say "
                f"`input={shell_text(f'{name}*{sign}:UNIT')}`"
            )
    placed = assign_times(recording, series, time, sample_time)
    if isinstance(placed, str):
        missing.append(placed)
    if missing or isinstance(placed, str):
        raise MissingInformation(recording.source.name or recording.name, missing)
    with_times, about_times = placed
    _check_differ(recording, with_times)
    replaced = any(each.t is not series[role].t for role, each in with_times.items())
    before = [each for each in recording.findings if not (replaced and each.code.startswith("time-"))]
    if time is not None and time.unit is not None:
        # Its unit is no convention any more.
        before = [each for each in before if each.code != "time-recognised"]
    before = demote_unused(before, (each.channel.name for each in series.values()))
    about_roles = [finding for part in parts.values() for finding in part.findings]
    if "current" in with_times:
        with_times["current"], about_current = _armature_current(recording, with_times["current"])
        about_roles.append(about_current)
    return _Roles(series=with_times, findings=(*about_roles, *about_times)), before


def _armature_current(recording: Recording, series: Series) -> tuple[Series, Finding]:
    """The measured current under the name that comes before all others, and the finding that says so."""
    name = series.channel.name
    if name != ARMATURE_CURRENT and ARMATURE_CURRENT in recording:
        raise UsageError(
            f"{recording.name}: `{name}` is named as the current, but there is a channel `{ARMATURE_CURRENT}`; use "
            "that one, or rename it"
        )
    sentence = f"`{name}` is the armature's current, as requested; it is called `{ARMATURE_CURRENT}`."
    channel = replace(series.channel, name=ARMATURE_CURRENT)
    return replace(series, channel=channel), info("current-named", sentence)


def _check_differ(recording: Recording, series: dict[Role, Series]) -> None:
    """Raise `UsageError` where one column is to be two things."""
    roles: dict[str, Role] = {}
    for role, each in series.items():
        name = each.channel.name
        if name in roles:
            kind = f"both {roles[name]} and {role}"
            raise UsageError(f"{recording.name}: the column `{name}` can't be {kind}")
        roles[name] = role


_CHOICES = "recordings"
_EACH = "recording"
_TURN = "counts_per_rev"


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """The arguments of `assign` as a value, which a TOML file can hold.

    `time`, `input`, `output`, `reference`, `supply` and `current` are columns, each as `COL[:UNIT]`; the `supply` may be a
    constant with its unit, and so may the input, as `input_value`. `sample_time` [s], `counts_per_rev` [counts/rev] and `chain`
    are as for `assign`.

    `recordings` are the names of those that are meant, all where there are none; `each` says what is different in one, by name.
    """

    time: str | None = None
    input: str | None = None
    output: str | None = None
    reference: str | None = None
    supply: str | None = None
    current: str | None = None
    sample_time: float | None = None
    counts_per_rev: float | None = None
    chain: str = ""
    input_value: str | None = None
    recordings: tuple[str, ...] = ()
    each: dict[str, Mapping] = field(default_factory=dict)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Mapping:
        """Return the mapping in a TOML file; raises `UsageError` where it says anything else than a mapping can."""
        try:
            content = toml.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise UsageError(f"the mapping {os.fspath(path)} can't be read: {error}") from None
        several = content.pop(_EACH, {})
        if not isinstance(several, dict) or not all(isinstance(table, dict) for table in several.values()):
            raise UsageError(
                f'{os.fspath(path)}: {_EACH} is {several!r}; expected tables such as [{_EACH}."name of a recording"]'
            )
        each = {
            name: cls(**_check(f"{path}, [{_EACH}.{json.dumps(name)}]", table, _OWN))
            for name, table in several.items()
        }
        return cls(**_check(os.fspath(path), content, (*_OWN, _CHOICES)), each=each)

    def toml(self) -> str:
        """Return the mapping as the text of a TOML file, without what it doesn't say."""
        lines = [
            f"{name} = {toml_value(value)}\n" for name, value in self._settings().items() if name != "each"
        ]
        for name, own in self.each.items():
            lines.append(f"\n[{_EACH}.{toml_value(name)}]\n{own.toml()}")
        return "".join(lines)

    def override_with(self, other: Mapping) -> Mapping:
        """Return the mapping with all that another one says in place of what this one does."""
        settings = other._settings()
        if {"time", "sample_time"} & settings.keys():  # the one takes the place of the other
            settings = {"time": None, "sample_time": None, **settings}
        if {"input", "input_value"} & settings.keys():
            settings = {"input": None, "input_value": None, **settings}
        return replace(self, **settings)

    def of(self, name: str) -> Mapping:
        """Return what holds for the recording of that name."""
        own = self.each.get(name, Mapping())
        return replace(self, recordings=(), each={}).override_with(own)

    def assign_to(self, recording: Recording) -> Recording:
        """Return the recording with roles, units and times as this mapping says; raises what `assign` does."""
        own = self.of(recording.name)
        return assign(
            recording,
            time=own.time,
            input=own.input,
            output=own.output,
            reference=own.reference,
            supply=own.supply,
            current=own.current,
            sample_time=own.sample_time,
            counts_per_rev=own.counts_per_rev,
            chain=own.chain,
            input_value=own.input_value,
        )

    def _settings(self) -> dict[str, Any]:
        """The mapping's settings by name."""
        known = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in known.items() if value not in (None, "", (), {})}


_OWN = tuple(each.name for each in fields(Mapping) if each.name not in {_CHOICES, "each"})


def _check(where: str, content: dict[str, Any], known: Sequence[str]) -> dict[str, Any]:
    """The entries of a mapping, each of the type that it has to have; raises an error that says where and what was expected."""
    for key, value in content.items():
        if key not in known:
            raise UnknownName(f"entry in the mapping {where}", key, (*known, _EACH))
        if key == _CHOICES:
            if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
                raise UsageError(
                    f'{where}: {key} is {value!r}; expected a list of names such as {key} = ["run 1"]'
                )
        elif key == _TURN:
            if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
                raise UsageError(f"{where}: {key} is {value!r}; expected a number such as {key} = 2048")
        elif key != "sample_time" and not isinstance(value, str):
            raise UsageError(
                f'{where}: {key} is {value!r}; expected a text such as {key} = "{_EXAMPLES[key]}"'
            )
    checked = dict(content)
    if "sample_time" in checked:
        try:
            checked["sample_time"] = seconds(checked["sample_time"])
        except UsageError as error:
            raise type(error)(f"{where}: sample_time: {error}") from None
    if _CHOICES in checked:
        checked[_CHOICES] = tuple(checked[_CHOICES])
    return checked


_EXAMPLES = {
    "time": "t:s",
    "input": "u:V",
    "input_value": "50:%",
    "output": "y:deg/s",
    "reference": "r:deg",
    "supply": "vbat:V",
    "current": "i:A",
    "chain": "derivative | lowpass 50 rad/s",
}


def toml_value(value: object) -> str:
    """Return a text, a number or a list of texts as TOML has it."""
    if isinstance(value, tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def _merge(before: Sequence[Series], new: Iterable[Series]) -> tuple[Series, ...]:
    """The series of a recording with new ones in place of those of the same name, or behind them."""
    by_name = {series.channel.name: series for series in new}
    in_place = tuple(by_name.pop(series.channel.name, series) for series in before)
    return (*in_place, *by_name.values())

"""Which column of a file is what, in which unit.

A name that is recognised is a finding and not a silent choice. What isn't sure is asked for, all of it at once.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array, Channel
from servobench.errors import FormatError, MissingInformation, UnknownName, UsageError
from servobench.finding import Finding, info, warning
from servobench.formats.base import load
from servobench.formats.columns import heading, quoted, time_unit
from servobench.formats.times import in_words, increasing
from servobench.recording.recording import Recording, Series
from servobench.units import is_unit, quantity, unit

Role: TypeAlias = Literal["input", "output"]

VOLTS_BY_CONVENTION = frozenset({"u", "v", "voltage"})
"""The names of an input that mean volts where nobody says another unit."""

INPUT_NAMES = VOLTS_BY_CONVENTION | frozenset(
    {"volt", "volts", "vm", "um", "input", "control", "command", "cmd", "pwm", "duty", "duty_cycle", "applied"}
    | {"motor_voltage", "input_voltage", "applied_voltage", "control_voltage", "voltage_command", "command_voltage"}
    | {"plant_input", "control_input", "control_output", "controller_output", "motor_input"}
)
"""The names by which a motor's input is recognised, in lower case and without a unit."""

OUTPUT_NAMES = frozenset(
    {"y", "theta", "omega", "θ", "ω", "speed", "velocity", "vel", "position", "pos", "angle", "phi", "counts", "encoder"}
    | {"rpm", "tachometer", "encoder_counts", "motor_speed", "motor_position", "motor_angle", "shaft_speed", "shaft_angle"}
    | {"angular_velocity", "angular_speed", "angular_position", "angular_rate"}
)
"""The names by which a motor's measured output is recognised, in lower case and without a unit."""

_MOST_LEFT_OUT = 0.1  # of the samples, for times that go back; more than that is another run, or another column
_RUN = 10  # samples that follow a jump far back before it is another run

_FIRST_SENTENCE = {
    "input": "which column is the input, what drives the motor: say --input COL:UNIT",
    "output": "which column is the output, what was measured of the motor: say --output COL:UNIT",
}
_EXAMPLE = {"input": "V", "output": "deg/s"}


@dataclass(frozen=True, kw_only=True)
class ColumnSpec:
    """A column as a user names it, `COL[:UNIT]`: a header's name, a variable's, or a column's number counted from 1.

    `FILE#COL` is a column of another file.
    """

    column: str
    unit: str | None = None

    @classmethod
    def parse(cls, text: str) -> ColumnSpec:
        """Return the column in a text; what follows the last colon is a unit only if it is one that is known."""
        column, colon, tail = text.rpartition(":")
        if colon and column and is_unit(tail):
            return cls(column=column, unit=tail.strip())
        return cls(column=text)

    def __str__(self) -> str:
        return self.column if self.unit is None else f"{self.column}:{self.unit}"


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """The arguments of `assign` as a value that a TOML file can hold; texts as in `ColumnSpec`, `sample_time` in s."""

    time: str | None = None
    input: str | None = None
    output: str | None = None
    sample_time: float | None = None
    chain: str = ""

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Mapping:
        """Return the mapping in a TOML file; raises `UsageError` where it says anything else than a mapping can."""
        try:
            content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise UsageError(f"the mapping {path} can't be read: {error}") from None
        known = [field.name for field in fields(cls)]
        for key, value in content.items():
            if key not in known:
                raise UnknownName(f"entry of a mapping, as in {path},", key, known)
            if key != "sample_time" and not isinstance(value, str):
                raise UsageError(f"{path}: {key} is {value!r}; expected a text such as {key} = \"u:V\"")
        if "sample_time" in content:
            content["sample_time"] = _seconds(content["sample_time"])
        return cls(**content)

    def toml(self) -> str:
        """Return the mapping as the text of a TOML file, without what it doesn't say."""
        said = [(field.name, getattr(self, field.name)) for field in fields(self)]
        return "".join(f"{name} = {_toml(value)}\n" for name, value in said if value not in (None, ""))

    def overridden_by(self, other: Mapping) -> Mapping:
        """Return the mapping with all that another one says in place of what this one does."""
        said = {field.name: getattr(other, field.name) for field in fields(other)}
        said = {name: value for name, value in said.items() if value not in (None, "")}
        if {"time", "sample_time"} & said.keys():  # the one takes the place of the other
            said = {"time": None, "sample_time": None, **said}
        return replace(self, **said)

    def assign(self, recording: Recording) -> Recording:
        """Return the recording with its roles and units set; see `assign`."""
        return assign(recording, **{field.name: getattr(self, field.name) for field in fields(self)})


def _toml(value: str | float) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(float(value))


def _seconds(given: object) -> float:
    if isinstance(given, bool) or not isinstance(given, int | float | str):
        raise UsageError(f"the sample time is {given!r}; expected seconds, such as 0.02, or a text such as \"20 ms\"")
    seconds = quantity(given, "s")
    if not 0.0 < seconds < np.inf:
        raise UsageError(f"the sample time is {given!r}; expected a positive finite number of seconds, such as 0.02")
    return seconds


@dataclass(frozen=True, kw_only=True)
class Recognised:
    """A channel that is recognised as the input or the output, its unit (None where it has to be asked for), and why."""

    name: str
    unit: str | None
    finding: Finding


def assign(
    recording: Recording,
    *,
    time: str | ColumnSpec | None = None,
    input: str | ColumnSpec | None = None,
    output: str | ColumnSpec | None = None,
    sample_time: float | None = None,
    chain: str = "",
) -> Recording:
    """Return the recording with input and output set, both with unit and times.

    What is given comes first, then what the recording knows itself, then what its names say; `u` and `voltage` are taken as V and
    `t` and `time` as s where nobody says otherwise. `sample_time` [s] makes times k·sample_time for samples without any, or instead
    of the file's. Rows of the two channels whose time doesn't increase, or that have no finite value, are left out, with a finding.
    `chain` is the text of what lies between the shaft and the output.
    Raises `MissingInformation` with a sentence for each thing that has to be said, `UnknownName` for a column that isn't there, and
    `UsageError` for what can't be so.
    """
    if time is not None and sample_time is not None:
        raise UsageError(
            f"both a time column ({time}) and a sample time ({sample_time:g} s) are given: say one of them"
        )
    missing: list[str] = []
    roles: dict[Role, _Chosen] = {}
    for role, given in (("input", input), ("output", output)):
        chosen = _chosen(recording, role, _spec(given), [each.series.channel.name for each in roles.values()])
        if isinstance(chosen, str):
            missing.append(chosen)
        else:
            roles[role] = chosen
    timed = _timed(recording, roles, _spec(time), sample_time)
    if isinstance(timed, str):
        missing.append(timed)
    if missing or isinstance(timed, str):
        raise MissingInformation(recording.source.name or recording.name, missing)
    series, findings = timed
    if series["input"].channel.name == series["output"].channel.name:
        raise UsageError(f"{recording.name}: the column `{series['input'].channel.name}` can't be both input and output")
    series, about_rows = _usable(recording.name, series)
    replaced = time is not None or sample_time is not None
    before = [each for each in recording.findings if not (replaced and each.code.startswith("time-"))]
    told = [finding for each in roles.values() for finding in each.findings]
    return replace(
        recording,
        series=_merged(recording.series, series.values()),
        input=series["input"].channel.name,
        output=series["output"].channel.name,
        chain=chain.strip() or recording.chain,
        findings=(*before, *told, *findings, *about_rows),
    )


def _spec(given: str | ColumnSpec | None) -> ColumnSpec | None:
    return ColumnSpec.parse(given) if isinstance(given, str) else given


@dataclass(frozen=True, kw_only=True)
class _Chosen:
    """The series of a role, in its unit, and what is to be known of the choice."""

    series: Series
    findings: tuple[Finding, ...] = ()


def _chosen(recording: Recording, role: Role, spec: ColumnSpec | None, taken: Sequence[str]) -> _Chosen | str:
    """The series for a role; or the sentence that asks for it or its unit."""
    known = getattr(recording, role)
    if spec is not None:
        series, findings = _found(recording, spec, role)
        symbol = spec.unit or series.channel.unit
    elif known is not None:
        series, findings = recording[known], []
        symbol = series.channel.unit
    else:
        candidates = recognised(recording, role, without=taken)
        if len(candidates) != 1:
            return _which(recording, role, [each.name for each in candidates])
        series, findings = recording[candidates[0].name], [candidates[0].finding]
        symbol = candidates[0].unit
    name = series.channel.name
    if symbol is None and role == "input" and _plain(name) in VOLTS_BY_CONVENTION:
        symbol = "V"
        findings.append(_by_convention(name))
    if symbol is None:
        return f"the unit of the {role} `{name}`: say --{role} {_shell(name)}:UNIT, such as {_shell(f'{name}:{_EXAMPLE[role]}')}"
    _check_unit(recording, role, name, symbol)
    if series.channel.unit not in (None, symbol):
        sentence = f"`{name}` is taken in {symbol}, as said; the file says {series.channel.unit}."
        findings.append(info("unit-overridden", sentence))
    return _Chosen(series=_in_unit(series, symbol), findings=tuple(findings))


def _by_convention(name: str) -> Finding:
    sentence = f"`{name}` is taken in V by convention; if it is something else say --input {_shell(f'{name}:UNIT')}."
    return info("unit-by-convention", sentence)


def _in_unit(series: Series, symbol: str) -> Series:
    """The series with another unit of its values, which stay; what was known in the old unit is gone."""
    channel = series.channel
    if channel.unit == symbol:
        return series
    if channel.unit is not None:
        channel = replace(channel, minimum=None, maximum=None, resolution=None)
    return replace(series, channel=replace(channel, unit=symbol))


def _check_unit(recording: Recording, role: Role, name: str, symbol: str) -> None:
    what = unit(symbol).quantity
    if role == "output" and what not in {"position", "speed"}:
        raise UsageError(
            f"{recording.name}: the output `{name}` is in {symbol}; expected a position (rad, deg, rev, counts, m) or a speed "
            "(rad/s, deg/s, rpm, rev/s, counts/s, m/s)"
        )
    if role == "input" and what == "time":
        raise UsageError(f"{recording.name}: the input `{name}` is in {symbol}; expected a voltage, a duty or the like, no time")


def _which(recording: Recording, role: Role, candidates: Sequence[str]) -> str:
    """The sentence that asks which column has a role."""
    if candidates:
        options = " or ".join(f"--{role} {_shell(name)}" for name in candidates)
        return f"which column is the {role}, as {quoted(candidates)} may be: say {options}"
    names = [each.channel.name for each in recording.series]
    columns = f"column is {quoted(names)}" if len(names) == 1 else f"columns are {quoted(names, 30)}"
    sentence = f"{_FIRST_SENTENCE[role]}; the {columns}"
    if role == "input":
        sentence += ". A file without its input can't be identified; one that is in another file is FILE#COL"
    return sentence


def _shell(text: str) -> str:
    """A text as it has to be typed on a command line."""
    return text if all(letter.isalnum() or letter in "_.:/%-" for letter in text) else f'"{text}"'


def recognised(recording: Recording, role: Role, without: Sequence[str] = ()) -> tuple[Recognised, ...]:
    """Return the channels whose names, and units where they have some, are those of an input or of an output.

    Only where there is exactly one is it sure. `without` names channels that are something else.
    """
    found = []
    for series in recording.series:
        name, symbol = series.channel.name, series.channel.unit
        if name in without or not _fits(role, _plain(name), symbol):
            continue
        told = f"`{name}` is recognised as the {role} by its name"
        if symbol is None and role == "input" and _plain(name) in VOLTS_BY_CONVENTION:
            symbol = "V"
            told += ", and taken in V by convention"
        sentence = f"{told}; if that is wrong say --{role} COL:UNIT."
        found.append(Recognised(name=name, unit=symbol, finding=info(f"{role}-recognised", sentence)))
    return tuple(found)


def _plain(name: str) -> str:
    """A name without its folder and its unit, in lower case, with underscores between words."""
    said = heading(name.rpartition(".")[2] or name)
    plain = "_".join(said.name.lower().replace("-", " ").replace("_", " ").split())
    return plain.rpartition("_")[0] or plain if said.from_name else plain


def _fits(role: Role, plain: str, symbol: str | None) -> bool:
    what = None if symbol is None else unit(symbol).quantity if is_unit(symbol) else "other"
    if role == "output":
        return what in {None, "position", "speed"} and (plain in OUTPUT_NAMES or (plain == "v" and what == "speed"))
    return what in {None, "voltage", "duty", "current", "other"} and plain in INPUT_NAMES


def _found(recording: Recording, spec: ColumnSpec, role: Role | None) -> tuple[Series, list[Finding]]:
    """The series that a user names, and what is to be known of how it was found."""
    names = [each.channel.name for each in recording.series]
    for text in (str(spec), spec.column, heading(spec.column).name):
        if text in names:
            return recording[text], []
    if spec.column.isdecimal() and 1 <= int(spec.column) <= len(names):
        return recording.series[int(spec.column) - 1], []
    alike = [name for name in names if name.lower() == spec.column.lower()]
    if len(alike) == 1:
        return recording[alike[0]], [info("name-case", f"`{spec.column}` is taken to be `{alike[0]}`.")]
    by_side = _of_side(recording, spec, role)
    if by_side is not None:
        told = f"`{spec.column}` is taken to be `{by_side.channel.name}`, the {role} with that beginning."
        return by_side, [info("name-beginning", told)]
    file, sharp, column = spec.column.rpartition("#")
    if sharp and file:
        return _in_other_file(recording, file, replace(spec, column=column), role)
    raise UnknownName(f"column of {recording.source.name or recording.name}", spec.column, names)


def _of_side(recording: Recording, spec: ColumnSpec, role: Role | None) -> Series | None:
    """The one channel that begins with a name such as `left` and is a voltage for an input, a position or else a speed for an output.

    A unit that was said narrows the choice to its quantity.
    """
    beginning = spec.column.lower()
    wanted = {"input": ["voltage", "duty"], "output": ["position", "speed"], None: []}[role]
    if spec.unit is not None:
        wanted = [unit(spec.unit).quantity]
    for what in wanted:
        fitting = [
            each
            for each in recording.series
            if each.channel.name.lower().startswith(tuple(beginning + joint for joint in "_. -"))
            and each.channel.unit is not None
            and unit(each.channel.unit).quantity == what
        ]
        if len(fitting) == 1:
            return fitting[0]
    return None


def _in_other_file(
    recording: Recording, file: str, spec: ColumnSpec, role: Role | None
) -> tuple[Series, list[Finding]]:
    """A series of another file, under a name that this recording doesn't have."""
    path = Path(file)
    if not path.exists():
        path = Path(recording.source.name).parent / file
    others = load(path)
    if len(others) != 1:
        raise UsageError(f"{file} holds {len(others)} recordings; a column can come from a file with one")
    series, findings = _found(others[0], spec, role)
    name = f"{path.stem}.{series.channel.name}"
    while name in recording:
        name += "_"
    told = f"`{name}` comes from {file} (SHA-256 {others[0].source.sha256[:16]}...)."
    channel = replace(series.channel, name=name)
    return replace(series, channel=channel), [info("column-from-other-file", told), *others[0].findings, *findings]


_Timed: TypeAlias = tuple[dict[Role, Series], list[Finding]]


def _timed(
    recording: Recording, roles: dict[Role, _Chosen], time: ColumnSpec | None, sample_time: float | None
) -> _Timed | str:
    """The series of the roles with times; or the sentence that asks for times."""
    series = {role: chosen.series for role, chosen in roles.items()}
    if sample_time is not None:
        step = _seconds(sample_time)
        told = f"The times are {step:g} s apart, as said"
        told += "; those of the file aren't used." if any(each.t is not None for each in series.values()) else "."
        evenly = {role: replace(each, t=np.arange(len(each.values)) * step) for role, each in series.items()}
        return evenly, [info("sample-time-given", told)]
    if time is not None:
        return _with_time_column(recording, series, time)
    if all(each.t is not None for each in (series.values() if series else recording.series)):
        return series, []
    names = [each.channel.name for each in recording.series]
    return f"the times: say --sample-time 0.02, in s, or whatever it is; or --time COL:UNIT, of {quoted(names)}"


def _with_time_column(recording: Recording, series: dict[Role, Series], spec: ColumnSpec) -> _Timed | str:
    column, findings = _found(recording, spec, None)
    name = column.channel.name
    symbol = spec.unit or column.channel.unit or time_unit(heading(name))
    if symbol is None:
        return f"the unit of the time `{name}`: say --time {_shell(f'{name}:s')}, or {_shell(f'{name}:ms')}, or what it is"
    if not is_unit(symbol) or unit(symbol).quantity != "time":
        raise UsageError(f"{recording.name}: the time `{name}` is in {symbol}; expected s, ms or another unit of time")
    with np.errstate(over="ignore"):
        t = column.values * unit(symbol).factor
    for role, each in series.items():
        if len(each.values) != len(t):
            raise UsageError(
                f"{recording.name}: the time `{name}` has {len(t)} samples, the {role} `{each.channel.name}` {len(each.values)}; "
                "they must be as many"
            )
    if spec.unit is None and column.channel.unit is None:
        findings.append(info("time-recognised", f"`{name}` is taken in s by convention; else say --time {name}:ms."))
    return {role: replace(each, t=t) for role, each in series.items()}, findings


def _usable(name: str, series: dict[Role, Series]) -> tuple[dict[Role, Series], list[Finding]]:
    """The series without the samples that can't be used, and what is to be known of those."""
    findings: list[Finding] = []
    checked: list[tuple[Array, NDArray[np.bool_]]] = []
    usable: dict[Role, Series] = {}
    for role, each in series.items():
        t = np.asarray(each.t, dtype=np.float64)
        keep = next((keep for known, keep in checked if known is t or np.array_equal(known, t, equal_nan=True)), None)
        if keep is None:
            keep = increasing(t)
            checked.append((t, keep))
            findings.extend(_about_times(name, t, keep))
        finite = np.isfinite(each.values)
        if not finite[keep].all():
            findings.append(_left_out(role, each.channel.name, keep & ~finite))
        keep = keep & finite
        if keep.sum() < 2:
            raise FormatError(
                f"{name}: the {role} `{each.channel.name}` has {int(keep.sum())} samples with a time and a finite value; "
                "at least two are needed"
            )
        usable[role] = each if keep.all() else replace(each, values=each.values[keep], t=t[keep])
    return usable, findings


def _left_out(role: Role, name: str, which: NDArray[np.bool_]) -> Finding:
    samples = np.flatnonzero(which) + 1
    sentence = f"The {role} `{name}` has no finite value and is left out: {in_words(samples, 'sample')}."
    # Of an input that isn't known it isn't known either what it did; an output may well come now and then.
    severity = warning if role == "input" else info
    return severity("rows-left-out", sentence, rows=(int(samples[0]), int(samples[-1])))


def _about_times(name: str, t: Array, keep: NDArray[np.bool_]) -> list[Finding]:
    """The finding on samples without a usable time; raises `FormatError` where they are more than a slip."""
    if keep.all():
        return []
    finite = np.flatnonzero(np.isfinite(t))
    if len(finite) > 1 and (t[finite] == t[finite[0]]).all():
        raise FormatError(f"{name}: all times are {t[finite[0]]:g} s; name the right column with --time COL:UNIT")
    _check_one_run(name, t[finite], keep[finite])
    samples = np.flatnonzero(~keep) + 1
    sentence = f"No time, or one that isn't later than those before it, left out: {in_words(samples, 'sample')}."
    return [warning("rows-left-out", sentence, rows=(int(samples[0]), int(samples[-1])))]


def _check_one_run(name: str, t: Array, keep: NDArray[np.bool_]) -> None:
    """Raise `FormatError` where times t (N,) are those of several runs, or none at all."""
    back = ~keep & (np.diff(t, prepend=-np.inf) != 0)
    jumps = np.flatnonzero(np.diff(t) < 0)
    if not len(jumps):
        return
    k = int(jumps[np.argmin(t[jumps + 1] - t[jumps])])
    runs_on = len(t) - k - 1 >= _RUN and (~keep[k + 1 : k + 1 + _RUN]).all() or (~keep[max(k + 1 - _RUN, 0) : k + 1]).all()
    far = t[k] - t[k + 1] > 0.5 * (t[k] - t[0])
    if np.mean(back) > _MOST_LEFT_OUT or (far and runs_on):
        raise FormatError(
            f"{name}: the time goes back {len(jumps)} times, the furthest from {t[k]:g} s to {t[k + 1]:g} s at sample {k + 2}. Where "
            "the file holds several runs, or a counter that wrapped, cut it into one file for each; or name another column with --time"
        )


def _merged(before: Sequence[Series], new: Sequence[Series] | object) -> tuple[Series, ...]:
    raise NotImplementedError

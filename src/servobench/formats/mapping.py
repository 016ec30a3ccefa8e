"""Which column of a file is what, in which unit.

A name that is recognised is a finding and not a silent choice. What isn't sure is asked for, all of it at once.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np

from servobench.channels import Array
from servobench.errors import MissingInformation, UnknownName, UsageError
from servobench.finding import Finding, info, warning
from servobench.formats.columns import heading, quoted, time_unit
from servobench.formats.roles import (
    VOLTS_BY_CONVENTION,
    ColumnSpec,
    Role,
    found,
    plain_name,
    quantity_of,
    recognised,
    typed,
)
from servobench.formats.stale import stale
from servobench.formats.usable import usable
from servobench.recording.recording import Recording, Series
from servobench.units import quantity, unit

_MEANING = {"input": "what drives the motor", "output": "what was measured of the motor"}
_EXAMPLE = {"input": "V", "output": "deg/s"}


def assign(
    recording: Recording,
    *,
    time: str | ColumnSpec | None = None,
    input: str | ColumnSpec | None = None,
    output: str | ColumnSpec | None = None,
    sample_time: float | str | None = None,
    chain: str = "",
) -> Recording:
    """Return the recording with input and output set, both with unit and times.

    What is given comes first, then what the recording knows itself, then what its names say; `u` and `voltage` are taken as V
    and `t` and `time` as s where nobody says otherwise. `sample_time` [s] makes times k·sample_time for samples without any, or
    instead of the file's. Samples of the two channels whose time doesn't increase, or that have no finite value, are left out,
    with a finding. `chain` is the text of what lies between the shaft and the output.
    Raises `MissingInformation` with a sentence for each thing that has to be said, `UnknownName` for a column that isn't there,
    `FormatError` for times that can't be used, and `UsageError` for what can't be so.
    """
    if time is not None and sample_time is not None:
        raise UsageError(
            f"both a time column ({time}) and a sample time ({sample_time}) are given; say one of them"
        )
    missing: list[str] = []
    roles: dict[Role, _Chosen] = {}
    asked: dict[Role, str | ColumnSpec | None] = {"input": input, "output": output}
    for role, given in asked.items():
        taken = [each.series.channel.name for each in roles.values()]
        chosen = _chosen(recording, role, _spec(given, recording), taken)
        if isinstance(chosen, str):
            missing.append(chosen)
        else:
            roles[role] = chosen
    timed = _timed(recording, roles, _spec(time, recording), sample_time)
    if isinstance(timed, str):
        missing.append(timed)
    if missing or isinstance(timed, str):
        raise MissingInformation(recording.source.name or recording.name, missing)
    series, about_times = timed
    names = {role: each.channel.name for role, each in series.items()}
    if names["input"] == names["output"]:
        raise UsageError(f"{recording.name}: the column `{names['input']}` can't be both input and output")
    series, about_samples = usable(recording.name, series)
    if (refreshed := stale(series["output"].values)) is not None:
        sentence = refreshed.sentence(names["output"], series["output"].t)
        about_samples.append(warning("output-stale", sentence))
    replaced = time is not None or sample_time is not None
    before = [each for each in recording.findings if not (replaced and each.code.startswith("time-"))]
    about_roles = [finding for each in roles.values() for finding in each.findings]
    return replace(
        recording,
        series=_merged(recording.series, series.values()),
        input=names["input"],
        output=names["output"],
        chain=chain.strip() or recording.chain,
        findings=(*before, *about_roles, *about_times, *about_samples),
    )


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """The arguments of `assign` as a value, which a TOML file can hold."""

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
        except (OSError, ValueError, RecursionError) as error:
            raise UsageError(f"the mapping {os.fspath(path)} can't be read: {error}") from None
        known = [field.name for field in fields(cls)]
        for key, value in content.items():
            if key not in known:
                raise UnknownName(f"entry of a mapping such as {os.fspath(path)}", key, known)
            if key != "sample_time" and not isinstance(value, str):
                raise UsageError(
                    f'{os.fspath(path)}: {key} is {value!r}; expected a text such as {key} = "u:V"'
                )
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

    def assigned(self, recording: Recording) -> Recording:
        """Return the recording with roles, units and times as this mapping says; raises what `assign` does."""
        return assign(
            recording,
            time=self.time,
            input=self.input,
            output=self.output,
            sample_time=self.sample_time,
            chain=self.chain,
        )


def _toml(value: str | float) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def _seconds(given: object) -> float:
    """A sample time in s; raises `UsageError` where it can't be one."""
    if isinstance(given, bool) or not isinstance(given, int | float | str):
        raise UsageError(
            f'the sample time is {given!r}; expected seconds such as 0.02, or a text such as "20 ms"'
        )
    seconds = quantity(given, "s")
    if not 0.0 < seconds < np.inf:
        raise UsageError(f"the sample time is {given!r}; expected a positive number of seconds such as 0.02")
    return seconds


def _spec(given: str | ColumnSpec | None, recording: Recording) -> ColumnSpec | None:
    """The column that is meant; a channel's whole name is that channel, whatever a colon in it looks like."""
    if given is None or isinstance(given, ColumnSpec):
        return given
    return ColumnSpec(column=given) if given in recording else ColumnSpec.parse(given)


@dataclass(frozen=True, kw_only=True)
class _Chosen:
    """The series of a role, in its unit, and what is to be known of the choice."""

    series: Series
    findings: tuple[Finding, ...] = ()


def _chosen(recording: Recording, role: Role, spec: ColumnSpec | None, taken: Sequence[str]) -> _Chosen | str:
    """The series for a role; or the sentence that asks for it, or for its unit."""
    known = recording.input if role == "input" else recording.output
    findings: list[Finding] = []
    symbol = None
    if spec is not None:
        series, findings = found(recording, spec, role)
        symbol = spec.unit
    elif known is not None:
        series = recording[known]
    else:
        candidates = recognised(recording, role, without=taken)
        if len(candidates) != 1:
            return _which(recording, role, [each.name for each in candidates])
        series, findings, symbol = recording[candidates[0].name], [candidates[0].finding], candidates[0].unit
    name, said = series.channel.name, series.channel.unit
    symbol = symbol or said
    if symbol is None and role == "input" and plain_name(name) in VOLTS_BY_CONVENTION:
        symbol = "V"
        sentence = f"`{name}` is taken in V by convention; if it isn't say --input {typed(f'{name}:UNIT')}."
        findings.append(info("unit-by-convention", sentence))
    if symbol is None:
        example = typed(f"{name}:{_EXAMPLE[role]}")
        return f"the unit of the {role} `{name}`: say --{role} {typed(f'{name}:UNIT')}, such as {example}"
    _check_unit(recording, role, name, symbol)
    if said not in (None, symbol):
        findings.append(info("unit-overridden", f"`{name}` is taken in {symbol} and not in {said}, as said."))
    return _Chosen(series=_in_unit(series, symbol), findings=tuple(findings))


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
        raise UsageError(
            f"{recording.name}: the input `{name}` is in {symbol}; expected V, % or the like, no time"
        )


def _which(recording: Recording, role: Role, candidates: Sequence[str]) -> str:
    """The sentence that asks which column has a role, of those with such a name or else those that measure the right thing."""
    wanted = {"voltage", "duty"} if role == "input" else {"position", "speed"}
    names = [each.channel.name for each in recording.series]
    candidates = candidates or [name for name in names if quantity_of(recording[name].channel.unit) in wanted]
    if candidates:
        options = " or ".join(f"--{role} {_with_unit(recording, name)}" for name in candidates)
        return f"which column is the {role}, as {quoted(candidates)} may be: say {options}"
    columns = (
        f"the only column is {quoted(names)}" if len(names) == 1 else f"the columns are {_long(recording)}"
    )
    sentence = f"which column is the {role}, {_MEANING[role]}: say --{role} COL:UNIT; {columns}"
    if role == "input":
        sentence += ". Without an input nothing can be identified; one in another file is FILE#COL"
    return sentence


def _with_unit(recording: Recording, name: str) -> str:
    """A column as it has to be said, with a place for its unit where that isn't known."""
    return typed(name if recording[name].channel.unit else f"{name}:UNIT")


def _long(recording: Recording) -> str:
    """The columns that are as long as the longest; what is shorter is a setting, no signal."""
    most = max((len(each.values) for each in recording.series), default=0)
    return quoted([each.channel.name for each in recording.series if len(each.values) == most], 30)


_Timed: TypeAlias = tuple[dict[Role, Series], list[Finding]]


def _timed(
    recording: Recording, roles: dict[Role, _Chosen], time: ColumnSpec | None, sample_time: float | str | None
) -> _Timed | str:
    """The series of the roles with times; or the sentence that asks for times."""
    series = {role: chosen.series for role, chosen in roles.items()}
    if sample_time is not None:
        step = _seconds(sample_time)
        told = f"The times are {step:g} s apart, as said"
        told += (
            "; those of the file aren't used." if any(each.t is not None for each in series.values()) else "."
        )
        evenly = {
            role: replace(each, t=step * np.arange(len(each.values), dtype=np.float64))
            for role, each in series.items()
        }
        return evenly, [info("sample-time-given", told)]
    if time is not None:
        return _with_time_column(recording, series, time)
    has_times = [each.t is not None for each in series.values()]
    if all(has_times or [any(each.t is not None for each in recording.series)]):
        return series, []
    sentence = "the times: say --sample-time 0.02, in s, or whatever it is; or --time COL:UNIT"
    return sentence if len(recording.series) < 2 else f"{sentence}, one of {_long(recording)}"


def _with_time_column(recording: Recording, series: dict[Role, Series], spec: ColumnSpec) -> _Timed | str:
    column, findings = found(recording, spec, None)
    name = column.channel.name
    symbol = spec.unit or column.channel.unit
    if symbol is None and (symbol := time_unit(heading(name))) is not None:
        sentence = (
            f"`{name}` is taken in {symbol} by convention; if it isn't say --time {typed(f'{name}:UNIT')}."
        )
        findings.append(info("time-recognised", sentence))
    if symbol is None:
        return f"the unit of the time `{name}`: say --time {typed(f'{name}:s')}, or :ms, or what it is"
    if quantity_of(symbol) != "time":
        raise UsageError(f"{recording.name}: the time `{name}` is in {symbol}; expected s, ms or the like")
    with np.errstate(over="ignore"):
        t: Array = column.values * unit(symbol).factor
    for role, each in series.items():
        if len(each.values) != len(t):
            raise UsageError(
                f"{recording.name}: the time `{name}` has {len(t)} samples and the {role} `{each.channel.name}` has "
                f"{len(each.values)}; a time column has one for each"
            )
    return {role: replace(each, t=t) for role, each in series.items()}, findings


def _merged(before: Sequence[Series], new: Iterable[Series]) -> tuple[Series, ...]:
    """The series of a recording with new ones in place of those of the same name, or behind them."""
    by_name = {series.channel.name: series for series in new}
    kept = tuple(by_name.pop(series.channel.name, series) for series in before)
    return (*kept, *by_name.values())

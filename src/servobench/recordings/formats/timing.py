"""The times of the channels that have a role: their own, those of a column, or evenly spaced ones."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from servobench.core.channels import LONGEST_STEP, SHORTEST_STEP, Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.units import is_unit, quantity, unit
from servobench.recordings.formats.choice import long_columns
from servobench.recordings.formats.columns import TIME_NAMES, heading, quote, time_unit
from servobench.recordings.formats.roles import (
    ColumnSpec,
    Role,
    find_series,
    plain_name,
    quantity_of,
    shell_text,
)
from servobench.recordings.formats.times import time_findings
from servobench.recordings.recording import Recording, Series


def seconds(value: object) -> float:
    """Return a sample time in s; raises `UsageError` where it can't be one."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise UsageError(
            f'the sample time is {value!r}; expected seconds such as 0.02, or a text such as "20 ms"'
        )
    seconds = quantity(value, "s")
    if not SHORTEST_STEP <= seconds <= LONGEST_STEP:
        raise UsageError(
            f"the sample time is {value!r}; expected a positive number of seconds such as 0.02, "
            f"{SHORTEST_STEP:g} to {LONGEST_STEP:g}"
        )
    return seconds


Timed: TypeAlias = tuple[dict[Role, Series], list[Finding]]


def assign_times(
    recording: Recording,
    series: Mapping[Role, Series],
    time: ColumnSpec | None,
    sample_time: float | str | None,
) -> Timed | str:
    """Return the series with times, every `sample_time` [s] if given, and findings; or the sentence that asks for times.

    A sample time that the times in the file contradict is used, with a warning. Without either, a column of one value that is
    called a sample time or a rate gives it.
    """
    if sample_time is not None:
        step = seconds(sample_time)
        text = f"The times are {step:g} s apart, as requested"
        text += (
            "; the file's times aren't used." if any(each.t is not None for each in series.values()) else "."
        )
        evenly = {
            role: replace(each, t=step * np.arange(len(each.values), dtype=np.float64))
            for role, each in series.items()
        }
        return evenly, [*_contradictions(recording, series, step), info("sample-time-given", text)]
    if time is not None:
        return _with_time_column(recording, series, time)
    has_times = [each.t is not None for each in series.values()]
    if all(has_times or [any(each.t is not None for each in recording.series)]):
        return dict(series), []
    stated = _sample_time_in_file(recording)
    if stated is not None:
        step, text = stated
        evenly = {
            role: replace(each, t=step * np.arange(len(each.values), dtype=np.float64))
            for role, each in series.items()
        }
        return evenly, [info("sample-time-in-file", text)]
    sentence = _question(recording)
    reasons = (
        {"time-not-recognised"}
        if "may be the time" in sentence
        else {"time-not-recognised", "time-ambiguous"}
    )
    why = [each.sentence for each in recording.findings if each.code in reasons]
    return " ".join([f"{sentence}.", *why]) if why else sentence


def _question(recording: Recording) -> str:
    """The sentence that asks for the times: for the unit of what must be the time, or may be, or else for a column."""
    named = [each for each in recording.series if plain_name(each.channel.name) in TIME_NAMES]
    unnamed = [each for each in recording.series if each.channel.unit is None]
    for may_be, why in (
        (named, "by its name" if len(named) == 1 else "by their names"),
        (unnamed, "as it grows from row to row"),
    ):
        names = [each.channel.name for each in may_be if _runs(each.values)]
        if 0 < len(names) <= _FEW:
            options = " or ".join(f"`time={shell_text(f'{name}:s')}`" for name in names)
            return (
                f"the times: {quote(names)} may be the time {why}: say {options}, or :ms, or what the unit is; otherwise, for "
                "example, `sample_time=0.02` (in s)"
            )
    sentence = "the times: say, for example, `sample_time=0.02` (in s), or `time=COL:UNIT`"
    if len(recording.series) > 1:
        sentence += f", one of {long_columns(recording)}"
    return sentence


_FEW = 3  # columns; of more the sentence would be a list


def _runs(values: Array) -> bool:
    """Whether a column can be times: it grows all the way, but for a few slips, and doesn't just count the rows."""
    values = values[np.isfinite(values)]
    if len(values) < 3:
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(values)
    return bool(np.mean(steps > 0) > _GROWING and not (steps == 1.0).all())


_GROWING = 0.95  # of the steps

_TIME_OF_A_SAMPLE = frozenset(
    {"ts", "t_s", "dt", "delta_t", "sample_time", "sampletime", "sampling_time", "tsample"}
)
_RATE = frozenset(
    {"fs", "f_s", "sample_rate", "samplerate", "sampling_rate", "sampling_frequency", "sample_frequency"}
)
_AGREE = 0.02  # of a sample time: clocks of boards are off by less


def _contradictions(recording: Recording, series: Mapping[Role, Series], step: float) -> list[Finding]:
    """Whether the times that a file has, or the rate that it states, contradict the sample time that was given [s]."""
    stated = _sample_time_in_file(recording)
    if stated is not None and abs(stated[0] - step) > _AGREE * step:
        sentence = (
            f"The file states a sample time of {stated[0]:.4g} s, and the one that was given is {step:.4g} s: one of them is "
            "wrong. Leave `sample_time=...` out to use the file's."
        )
        return [warning("sample-time-contradicts", sentence)]
    for role in ("output", "input"):
        t = series[role].t if role in series else None
        steps = np.diff(t[np.isfinite(t)]) if t is not None else np.empty(0)
        own = float(np.median(steps[steps > 0])) if (steps > 0).any() else step
        if abs(own - step) > _AGREE * step:
            sentence = (
                f"The times of `{series[role].channel.name}` are {own:.4g} s apart, and the sample time that was given is "
                f"{step:.4g} s, {step / own:.3g} times that: one of them is wrong. Leave `sample_time=...` out to use the times."
            )
            return [warning("sample-time-contradicts", sentence)]
    return []


def _sample_time_in_file(recording: Recording) -> tuple[float, str] | None:
    """The sample time [s] that a column of one value gives, such as a rate in the first row alone, and how it was found."""
    for each in recording.series:
        name, values = plain_name(each.channel.name), each.values[np.isfinite(each.values)]
        is_rate = name in _RATE
        if not (is_rate or name in _TIME_OF_A_SAMPLE) or not len(values) or (values != values[0]).any():
            continue
        symbol = each.channel.unit or ("Hz" if is_rate else "s")
        if not is_unit(symbol) or unit(symbol).si != ("rad/s" if is_rate else "s") or not values[0] > 0:
            continue
        value = float(values[0]) * unit(symbol).factor
        step = 2 * np.pi / value if is_rate else value
        if SHORTEST_STEP <= step <= LONGEST_STEP:
            sentence = (
                f"The times are {step:.6g} s apart, as `{each.channel.name}` says ({values[0]:g} {symbol})."
            )
            return float(step), f"{sentence} If that is wrong, say `sample_time=S`."
    return None


def _with_time_column(recording: Recording, series: Mapping[Role, Series], spec: ColumnSpec) -> Timed | str:
    column, findings = find_series(recording, spec, None)
    name = column.channel.name
    for role, each in series.items():
        if each.channel.name == name:
            raise UsageError(
                f"{recording.name}: `{name}` was named as the time, so it can't be the {role} too"
            )
    symbol = spec.unit or column.channel.unit
    if symbol is None and (symbol := time_unit(heading(name))) is not None:
        sentence = (
            f"`{name}` is read in {symbol} by convention; otherwise say `time={shell_text(f'{name}:UNIT')}`."
        )
        findings.append(info("time-recognised", sentence))
    if symbol is None:
        return f"the unit of the time `{name}`: say `time={shell_text(f'{name}:s')}`, or :ms, or what it is"
    if quantity_of(symbol) != "time":
        raise UsageError(f"{recording.name}: the time `{name}` is in {symbol}; expected s, ms or the like")
    with np.errstate(over="ignore"):
        t: Array = column.values * unit(symbol).factor
    placed = {role: _at(recording, role, each, name, t) for role, each in series.items()}
    if any(each.t is t for each in placed.values()):
        findings += time_findings(t)
    return placed, findings


def _at(recording: Recording, role: Role, series: Series, name: str, t: Array) -> Series:
    """A series at the times t (N,) [s] of the column of that name; one that has those times already stays as it is."""
    if series.t is not None and np.array_equal(series.t, t, equal_nan=True):
        return series
    if len(series.values) == len(t):
        return replace(series, t=t)
    if series.t is not None and role in {"reference", "supply", "current"}:
        return series  # which may well be recorded at times of their own
    raise UsageError(
        f"{recording.name}: the time `{name}` has {len(t)} samples and the {role} `{series.channel.name}` has "
        f"{len(series.values)}; a time column has one for each"
    )

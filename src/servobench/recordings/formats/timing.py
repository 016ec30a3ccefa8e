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
from servobench.recordings.formats.clock_columns import clock_columns, clock_unit, repeats_rows
from servobench.recordings.formats.columns import heading, time_unit
from servobench.recordings.formats.likely_units import about_stated_unit
from servobench.recordings.formats.roles import (
    ColumnSpec,
    Role,
    find_series,
    plain_name,
    quantity_of,
    shell_text,
)
from servobench.recordings.formats.time_question import question
from servobench.recordings.formats.time_stamps import STAMP_FORMS
from servobench.recordings.formats.time_steps import STEP_NAMES, about_steps, step_unit
from servobench.recordings.formats.times import MeanStep, mean_step, time_findings
from servobench.recordings.formats.unreadable import check_readable
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
    sentence = question(recording)
    reasons = (
        {"time-not-recognised"}
        if "may be the time" in sentence
        else {"time-not-recognised", "time-ambiguous"}
    )
    why = [
        each.sentence for each in recording.findings if each.code in reasons or STAMP_FORMS in each.sentence
    ]
    return " ".join([f"{sentence}.", *why]) if why else sentence


_TIME_OF_A_SAMPLE = STEP_NAMES | {"ts", "t_s", "sampletime"}
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
    timed = [series[role] for role in ("output", "input") if role in series and series[role].t is not None]
    if not timed:
        return _contradiction_of_clocks(recording, step)
    by_convention = any(finding.code == "time-recognised" for finding in recording.findings)
    for each in timed:
        own = mean_step(np.asarray(each.t))
        numbers_rows = by_convention and bool((np.diff(np.asarray(each.t)) == 1.0).all())
        if own is not None and not _agrees(own, step) and not numbers_rows:
            remedy = "Leave `sample_time=...` out to use the times."
            return [_contradiction(f"The times of `{each.channel.name}` are", own, step, remedy)]
    return []


def _contradiction_of_clocks(recording: Recording, step: float) -> list[Finding]:
    """Whether all columns that are no times, but show how far apart the samples are, contradict a sample time [s]."""
    clocks = clock_columns(recording)
    if not clocks or any(_agrees(own, step) for clock in clocks for own in clock.steps):
        return []
    name, own = clocks[0].name, clocks[0].nearest(step)
    symbol = clock_unit(recording[name]) or "UNIT"
    remedy = (
        f"Say `time={shell_text(f'{name}:{symbol}')}` instead: rows with the same time are repeated, and left out then."
        if repeats_rows(recording, name)
        else f"If the column is right, say `sample_time={own.figure:.4g}`."
    )
    return [_contradiction(f"By the column `{name}` the samples are", own, step, remedy)]


def _agrees(own: MeanStep, step: float) -> bool:
    """Whether a sample time [s] is that of the file's times, as closely as those are known."""
    return abs(own.step - step) <= max(_AGREE * step, own.resolution)


def _contradiction(subject: str, own: MeanStep, step: float, remedy: str) -> Finding:
    sentence = (
        f"{subject} {own.step:.4g} s apart on average, and the sample time that was given is {step:.4g} s, "
        f"{step / own.step:.3g} times that: one of them is wrong. {remedy}"
    )
    return warning("sample-time-contradicts", sentence)


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
    check_readable(recording, column, "time")
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
    findings += about_stated_unit(column, symbol, "time")
    if step_unit(column, symbol) is not None:
        raise UsageError(f"{recording.name}: {about_steps(column, symbol)}")
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

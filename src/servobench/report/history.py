"""The tables of experiments and recordings, as plain texts."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from servobench.core import toml
from servobench.core.channels import Channel
from servobench.core.parameter_names import plain_words
from servobench.core.rounding import SPACE, count_text, group_digits, plain, with_unit
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Recording, Series
from servobench.report.tables import Fact, capital

_NOTHING: tuple[Any, ...] = ("", {}, [])  # what a setting that isn't set looks like
_SIDE_BY_SIDE = ("Samples", "Sample time", "Late", "Ended")


@dataclass(frozen=True, kw_only=True)
class RunHistory:
    """One recording: its name, facts about the way it went, and its channels, each as a row."""

    name: str
    facts: tuple[Fact, ...]
    channels: tuple[tuple[str, ...], ...]


def experiment_facts(recording: Recording) -> tuple[Fact, ...]:
    """Return what an experiment asked for, from its TOML text; nothing where there is none or it can't be read."""
    table = experiment_table(recording)
    own = table.pop("experiment", {})
    if isinstance(limits := table.get("limits"), Mapping):
        # The rest of that table follows from the guard's limits.
        table["limits"] = {"voltage": limits.get("voltage", "")}
    facts = {**own, **table} if isinstance(own, Mapping) else table
    return tuple(
        Fact(heading=capital(plain_words(key)), text=toml_text(value))
        for key, value in facts.items()
        if key != "name" and value not in _NOTHING
    )


def experiment_table(recording: Recording) -> dict[str, Any]:
    """Return the TOML text of a recording's experiment as a table; empty where there is none or it can't be read."""
    try:
        return toml.loads(recording.experiment)
    except (ValueError, RecursionError):
        return {}


def toml_text(value: Any) -> str:
    """Return a value out of a TOML file as a person says it: a table as its type and then its settings."""
    if isinstance(value, Mapping):
        head = value.get("type", value.get("name", ""))
        skipped = "type" if "type" in value else "name"
        parts = [
            _setting(key, item) for key, item in value.items() if key != skipped and item not in _NOTHING
        ]
        return ": ".join(part for part in (plain_words(str(head)), ", ".join(parts)) if part)
    if isinstance(value, list):
        return ", ".join(map(toml_text, value))
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return plain(value, 12)
    # No line ends between a number and its unit.
    return re.sub(r"^(\S*\d) (?=\S+$)", rf"\1{SPACE}", str(value))


def run_history(recording: Recording) -> RunHistory:
    """Return how a recording went: why it ended, how many samples, when, and how late."""
    times = (
        recording[recording.output]
        if recording.output
        else max(recording.series, key=lambda s: len(s.values), default=None)
    )
    facts = [Fact(heading="Ended", text=recording.stopped.sentence)]
    if times is not None:
        facts += _pace(times)
    facts += _lateness(recording) + _limits(recording)
    for heading, name in (("Input", recording.input), ("Output", recording.output)):
        if name is not None:
            facts.append(Fact(heading=heading, text=_channel(recording[name].channel)))
    if recording.chain:
        facts.append(Fact(heading="Came through", text=recording.chain, code=True))
    return RunHistory(
        name=recording.name,
        facts=tuple(facts),
        channels=tuple(_channel_row(series) for series in recording.series),
    )


def dataset_history(data: Dataset) -> RunHistory:
    """Return what a dataset alone says of the way it was recorded."""
    steps = Fact(
        heading="Samples", text=f"{count_text(len(data.y), 'sample')} in {with_unit(data.duration, 's')}"
    )
    pace = Fact(heading="Sample time", text=f"{with_unit(data.sample_time, 's')} (median)")
    return RunHistory(name=data.name, facts=(steps, pace), channels=())


def side_by_side(runs: Sequence[RunHistory]) -> tuple[tuple[str, ...], ...]:
    """Return several recordings as rows under a row of headings: the facts that fit into a table."""
    headings = [
        name for name in _SIDE_BY_SIDE if any(fact.heading == name for run in runs for fact in run.facts)
    ]
    known = [{fact.heading: fact.text for fact in run.facts} for run in runs]
    rows = (
        (run.name, *(facts.get(name, "–") for name in headings))
        for run, facts in zip(runs, known, strict=True)
    )
    return (("Record", *headings), *rows)


def origin_facts(recordings: Sequence[Recording]) -> tuple[Fact, ...]:
    """Return where recordings come from, each thing once: files, devices with their settings, versions."""
    facts: list[Fact] = []
    for recording in recordings:
        source, device = recording.source, recording.info
        if source.format != "run":
            facts.append(Fact(heading="File", text=f"{source.name} ({source.format})"))
        if device is not None:
            serial = f", serial number {device.serial}" if device.serial else ""
            delay = f", delay {with_unit(device.delay, 's')}" if device.delay else ""
            facts.append(Fact(heading="Device", text=f"{device.name}{serial}, {device.timing} time{delay}"))
            if device.settings:
                settings = ", ".join(f"{plain_words(key)} {value}" for key, value in device.settings)
                facts.append(Fact(heading="Device settings", text=settings))
        if recording.versions:
            versions = ", ".join(f"{name} {version}" for name, version in recording.versions.items())
            facts.append(Fact(heading="Recorded with", text=versions))
    return tuple(dict.fromkeys(facts))


def command(recordings: Sequence[Recording]) -> str:
    """Return a command that identifies the same recordings again, as far as they say where they come from.

    The files of a run are called what they are called in its folder.
    """
    files = [recording for recording in recordings if recording.source.format != "run"]
    if not recordings:
        return ""
    if not files:
        was_asked = any(recording.experiment for recording in recordings)
        again = "servobench run experiment.toml\n" if was_asked else ""
        return f"{again}servobench identify recording.mcap"
    words = ["servobench", "identify", *dict.fromkeys(recording.source.name for recording in files)]
    first = files[0]
    if first.source.format != "mcap":  # which says itself what is what
        for option, name in (("--input", first.input), ("--output", first.output)):
            if name is not None:
                unit = first[name].channel.unit
                words += [option, f"{name}:{unit}" if unit else name]
        if first.chain:
            words += ["--chain", first.chain]
    return shlex.join(words)


def _pace(series: Series) -> list[Fact]:
    count = count_text(len(series.values), "sample")
    t = series.t
    if t is None:
        return [Fact(heading="Samples", text=f"{count}; the file has no times")]
    if len(t) < 2:
        return [Fact(heading="Samples", text=count)]
    steps = np.diff(t)
    median, low, high = (with_unit(float(x), "s") for x in (np.median(steps), steps.min(), steps.max()))
    even = low == high
    pace = median if even else f"{median} (median; {low} to {high})"
    return [
        Fact(heading="Samples", text=f"{count} in {with_unit(float(t[-1] - t[0]), 's')}"),
        Fact(heading="Sample time", text=pace),
    ]


def _lateness(recording: Recording) -> list[Fact]:
    """The facts on late samples, for a run of ours."""
    if "late" not in recording or "scheduled" not in recording:
        return []
    late, scheduled = recording["late"].values, recording["scheduled"]
    number = int(np.count_nonzero(late))
    if scheduled.t is None or not len(late):
        return []
    worst = float(np.max(scheduled.t - scheduled.values))
    text = f"{group_digits(number)} of {group_digits(len(late))} samples" if number else "none"
    return [
        Fact(heading="Late", text=f"{text}; the latest by {with_unit(worst, 's', 3)}" if worst > 0 else text)
    ]


def _limits(recording: Recording) -> list[Fact]:
    """The fact on how often the device's output differed from the command."""
    if "commanded" not in recording or "applied" not in recording:
        return []
    commanded, applied = recording["commanded"].values, recording["applied"].values
    if commanded.shape != applied.shape:
        return []
    number = int(np.count_nonzero(commanded != applied))
    text = f"at {count_text(number, 'sample')} of {group_digits(len(applied))}" if number else "never"
    return [Fact(heading="Limited by the device", text=text)]


def _channel(channel: Channel) -> str:
    unit = channel.unit or "no unit given"
    details = [unit]
    if channel.counts_per_rev:
        details.append(f"{plain(channel.counts_per_rev, 12)} counts a turn")
    if channel.counter_bits:
        details.append(f"{channel.counter_bits}-bit counter")
    return f"{channel.name} ({', '.join(details)})"


def _channel_row(series: Series) -> tuple[str, ...]:
    """Name, unit, samples, smallest and largest value."""
    values = series.values[np.isfinite(series.values)]
    ends = (plain(float(values.min()), 6), plain(float(values.max()), 6)) if len(values) else ("–", "–")
    return (series.channel.name, series.channel.unit or "–", group_digits(len(series.values)), *ends)


def _setting(key: str, value: Any) -> str:
    inner = toml_text(value)
    return f"{plain_words(key)} ({inner})" if isinstance(value, Mapping) else f"{plain_words(key)} {inner}"

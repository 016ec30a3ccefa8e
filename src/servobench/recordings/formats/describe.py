"""The contents of a recording: its channels, its times, and the information missing for an identification."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array, measurable
from servobench.core.errors import MissingInformation, UsageError
from servobench.core.finding import Finding
from servobench.core.rounding import count_text
from servobench.recordings.formats.columns import TIME_NAMES, heading, time_unit
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.formats.roles import ColumnSpec, Role, plain_name, quantity_of, recognise
from servobench.recordings.formats.times import TimeBase, time_base
from servobench.recordings.formats.unreadable import has_numbers
from servobench.recordings.recording import Recording, Series, Source

_ON_GRID = 0.95  # of the steps between the values of a quantised channel are whole numbers of its quantum
_NEAR_WHOLE = 0.05
_ROUNDING = 1e-9  # of the largest value: what lies closer together differs by rounding alone


@dataclass(frozen=True, kw_only=True)
class ChannelDescription:
    """A summary of the values of a channel, `name`, in its unit.

    Of its `samples` some are `non_finite`. `minimum` and `maximum` are None where there is no finite value. `levels` counts
    the different values, `quantum` is the step between them where they lie on a grid. `repeated` is the share of samples that
    equal the one before. `times` is the place of the channel's times in the description's `time_bases`, None where it has none.
    """

    name: str
    unit: str | None
    samples: int
    non_finite: int
    minimum: float | None
    maximum: float | None
    levels: int
    quantum: float | None
    repeated: float | None
    times: int | None


@dataclass(frozen=True, kw_only=True, repr=False)
class Description:
    """A recording's content, and what is missing for an identification.

    `mapping` says what is known or recognised of time, input and output. `missing` has a sentence for each thing that has to be
    said first, or that stands in the way. `findings` are all there are, those of recognising included.
    `name` and `source` are the recording's, `channels` and `time_bases` what its values and its times are like.
    """

    name: str
    source: Source
    channels: tuple[ChannelDescription, ...]
    time_bases: tuple[TimeBase, ...]
    mapping: Mapping
    missing: tuple[str, ...]
    findings: tuple[Finding, ...]

    def __str__(self) -> str:
        """The recording's content as lines: its channels, what was recognised, and what is missing."""
        lines = [f"{self.name}: {count_text(len(self.channels), 'channel')}"]
        for each in self.channels:
            ends = "" if each.minimum is None else f", {each.minimum:.6g} to {each.maximum:.6g}"
            lines.append(f"  {each.name} in {each.unit or '?'}: {count_text(each.samples, 'sample')}{ends}")
        for role in ("time", "input", "output"):
            lines.append(f"  {role}: {getattr(self.mapping, role) or 'not recognised'}")
        lines += [f"- {finding.sentence}" for finding in self.findings]
        return "\n".join([*lines, *(f"- missing: {sentence}" for sentence in self.missing)])

    def __repr__(self) -> str:
        """The recording in one line."""
        channels = ", ".join(each.name for each in self.channels)
        return f"<Description {self.name}: {channels}; {len(self.missing)} missing>"


def describe(recording: Recording, mapping: Mapping | None = None) -> Description:
    """Return what is in a recording, with what was said of its columns."""
    mapping = mapping or Mapping()
    different: list[Array] = []
    channels = tuple(_channel(series, _place(series.t, different)) for series in recording.series)
    missing: tuple[str, ...] = ()
    findings = recording.findings
    try:
        findings = mapping.assign_to(recording).findings
    except MissingInformation as error:
        missing = error.missing
    except UsageError as error:
        missing = (str(error),)
    return Description(
        name=recording.name,
        source=recording.source,
        channels=channels,
        time_bases=tuple(time_base(t) for t in different),
        mapping=_complete_mapping(recording).override_with(mapping),
        missing=missing,
        findings=findings,
    )


def channels_to_show(recording: Recording, most: int = 4) -> tuple[str, ...]:
    """Return the names of the channels to look at: input and output where they are known, or else what they may be.

    What may be the input is in a unit of voltage or duty, what may be the output in one of position or speed; where no unit is
    known either, the first channels that change are shown.
    """
    known = _complete_mapping(recording)
    times = None if known.time is None else ColumnSpec.parse(known.time).column
    named: list[str] = []
    for column, quantities in ((known.input, {"voltage", "duty"}), (known.output, {"position", "speed"})):
        if column is not None:
            named.append(column if column in recording else ColumnSpec.parse(column).column)
            continue
        may_be = [
            each.channel.name
            for each in recording.series
            if quantity_of(each.channel.unit) in quantities and has_numbers(each)
        ]
        named += may_be[: most // 2]
    if len(named) > 1:
        return tuple(dict.fromkeys(named))
    longest = max((len(series.values) for series in recording.series), default=0)
    changing = [
        series.channel.name
        for series in recording.series
        if series.channel.name != times
        and plain_name(series.channel.name) not in TIME_NAMES
        and len(series.values) == longest
        and _changes(series.values)
    ]
    return tuple(dict.fromkeys([*named, *changing]))[:most]


def _changes(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return len(finite) > 0 and bool(finite.min() < finite.max())


def _complete_mapping(recording: Recording) -> Mapping:
    """The given or recognised time, input and output."""
    return Mapping(
        time=_time_column(recording),
        input=_role_channel(recording, "input", recording.input),
        output=_role_channel(recording, "output", recording.output),
        reference=recording.reference,
        chain=recording.chain,
    )


def _role_channel(recording: Recording, role: Role, known: str | None) -> str | None:
    if known is not None:
        return str(ColumnSpec(column=known, unit=recording[known].channel.unit))
    candidates = recognise(recording, role)
    return (
        str(ColumnSpec(column=candidates[0].name, unit=candidates[0].unit)) if len(candidates) == 1 else None
    )


def _time_column(recording: Recording) -> str | None:
    """The channel that the times of the others come from, where it is one of the channels."""
    for series in recording.series:
        label = heading(series.channel.name)
        symbol = time_unit(replace(label, unit=series.channel.unit or label.unit))
        if series.t is not None and symbol is not None:
            return str(ColumnSpec(column=series.channel.name, unit=symbol))
    return None


def _place(t: Array | None, different: list[Array]) -> int | None:
    """The place of times among those that differ, where they are added if they are new."""
    if t is None:
        return None
    for k, known in enumerate(different):
        if known is t or np.array_equal(known, t, equal_nan=True):
            return k
    different.append(t)
    return len(different) - 1


def _channel(series: Series, times: int | None) -> ChannelDescription:
    finite = series.values[np.isfinite(series.values)]
    levels = np.unique(finite)
    return ChannelDescription(
        name=series.channel.name,
        unit=series.channel.unit,
        samples=len(series.values),
        non_finite=len(series.values) - len(finite),
        minimum=float(levels[0]) if len(levels) else None,
        maximum=float(levels[-1]) if len(levels) else None,
        levels=len(levels),
        quantum=quantum(finite),
        repeated=float(np.mean(finite[1:] == finite[:-1])) if len(finite) > 1 else None,
        times=times,
    )


def quantum(values: Array) -> float | None:
    """Return the step of values (N,) that are quantised; None where they aren't, or there are too few to tell.

    It is the smallest step between two different values, or a half or a third of it, and counts where nearly all other steps are
    whole numbers of it.
    """
    values = measurable(values)
    return _step_of(np.unique(values[np.isfinite(values)]))


def _step_of(levels: Array) -> float | None:
    """The quantum of values that are sorted and differ."""
    if len(levels) < 3:
        return None
    with np.errstate(over="ignore"):
        steps = np.diff(levels)
        steps = steps[np.isfinite(steps) & (steps > _ROUNDING * np.abs(levels).max())]
    if len(steps) < 2:
        return None
    # No two values may happen to be one quantum apart, but then two or three.
    for quantum in steps.min() / np.arange(1.0, 4.0):
        ratios = steps / quantum
        if np.mean(np.abs(ratios - np.rint(ratios)) < _NEAR_WHOLE) > _ON_GRID:
            return float(quantum)
    return None

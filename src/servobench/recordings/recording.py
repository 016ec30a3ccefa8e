"""A recording: all raw data of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from servobench.core.channels import Array, Channel, DeviceInfo
from servobench.core.errors import UsageError
from servobench.core.finding import Finding
from servobench.core.plotting import ground, lay_out, new_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

StopReason: TypeAlias = Literal["finished", "interrupted", "fault", "device_lost", "error", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Stopped:
    """The reason why a run ended: `finished` as requested, or cut short; the sentence says it in words."""

    reason: StopReason
    """The kind of the end."""
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Event:
    """One thing that happened in a run beside its samples, such as a command that was taken or a fault.

    `tick` is the first tick that it concerns, `time` [s] when it happened, in the run's own count. `kind` is one word, such as
    `command` or `fault`; `text` says the rest as JSON.
    """

    tick: int
    time: float
    kind: str
    text: str


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Series:
    """The samples of one channel.

    `values` has shape (N,) and is in the channel's unit, as recorded. `t` [s] has the same shape, or is None where the
    file that it comes from has no times. Raises `UsageError` where the shapes differ.
    """

    channel: Channel
    values: Array
    t: Array | None

    def __repr__(self) -> str:
        """The channel and how many samples it has."""
        return f"<Series {self.channel.name} in {self.channel.unit or '?'}: {len(self.values)} samples>"

    def __post_init__(self) -> None:
        if self.values.ndim != 1 or (self.t is not None and self.t.shape != self.values.shape):
            times = "no times" if self.t is None else f"times of shape {self.t.shape}"
            raise UsageError(
                f"channel {self.channel.name!r} has values of shape {self.values.shape} and {times}; expected (N,) both"
            )

    def __eq__(self, other: object) -> bool:
        """Same channel, same values and same times, NaN equal to NaN."""
        if not isinstance(other, Series) or self.channel != other.channel:
            return False
        if self.t is None or other.t is None:
            times = self.t is other.t
        else:
            times = np.array_equal(self.t, other.t, equal_nan=True)
        return times and np.array_equal(self.values, other.values, equal_nan=True)

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True, kw_only=True)
class Source:
    """A recording's origin: a path or a device's name, the SHA-256 of the file (empty for a run), its format."""

    name: str
    sha256: str = ""
    """Checksum of the file, empty where there is none."""
    format: str = "run"


@dataclass(frozen=True, kw_only=True, repr=False)
class Recording:
    """The raw channels of a run, each with its own times.

    `input` and `output` name the channels with the motor's input and measured output, or are None if these
    aren't known yet. Sample k of the output is latched at t_k before input k acts; input k holds from its
    time to the next. `input_before` is the input before the first sample; if it is None, the first value is
    used. `starts_at_rest` says that the shaft is at rest at the first sample and the input was zero until
    then, as in a SysId test. `chain` describes the stages between the shaft and the output channel as text:
    empty for a raw encoder or if unknown, `none` if there are none. `reference` names the channel with the
    reference of a feedback loop. A servobench run has `commanded` and `applied` [V], `counts`, `scheduled`
    [s], `late` and `saturated` (0 or 1), `tachometer` and `current` if the device has them, and `reference`
    if a controller follows one. `experiment` is the experiment's TOML text, empty if there was none. `events`
    are in chronological order. Raises `UsageError` for a repeated name, and for a role without a channel.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> recording.input, recording.output
    ('applied', 'counts')
    """

    name: str
    series: tuple[Series, ...]
    """The channels with their samples."""
    source: Source
    """The file or the device that it comes from."""
    input: str | None = None
    output: str | None = None
    input_before: float | None = None
    starts_at_rest: bool = False
    chain: str = ""
    reference: str | None = None
    info: DeviceInfo | None = None
    """The device's description of itself, None if no device is known."""
    experiment: str = ""
    findings: tuple[Finding, ...] = ()
    """Remarks on the recording."""
    stopped: Stopped = Stopped(reason="unknown", sentence="the file doesn't say why the recording ended")
    """Its end, None if unknown."""
    versions: Mapping[str, str] = field(default_factory=dict)
    """Programs and their versions that made it."""
    events: tuple[Event, ...] = ()

    def __repr__(self) -> str:
        """The name, the channels, and which of them are input and output."""
        channels = ", ".join(f"{each.channel.name} ({len(each.values)})" for each in self.series)
        return f"<Recording {self.name}: {channels}; input {self.input or '?'}, output {self.output or '?'}>"

    def __post_init__(self) -> None:
        names = [series.channel.name for series in self.series]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise UsageError(
                f"recording {self.name!r} has two channels called {', '.join(twice)}: rename one"
            )
        for role, name in (
            ("input", self.input),
            ("output", self.output),
            ("reference", self.reference),
        ):
            if name is not None and name not in names:
                raise UsageError(
                    f"the {role} {name!r} isn't a channel of recording {self.name!r}; it has {', '.join(names)}"
                )

    def __getitem__(self, name: str) -> Series:
        """Return the series of that channel; raises `UsageError`, which lists the channels, where there is none."""
        for series in self.series:
            if series.channel.name == name:
                return series
        known = ", ".join(series.channel.name for series in self.series)
        raise UsageError(f"recording {self.name!r} has no channel {name!r}; it has {known}")

    def __contains__(self, name: str) -> bool:
        return any(series.channel.name == name for series in self.series)

    def with_findings(self, *findings: Finding) -> Recording:
        """Return the same recording with further findings."""
        return replace(self, findings=(*self.findings, *findings))

    def plot(
        self, *names: str, axes: Axes | Sequence[Axes] | None = None, dark: bool = False
    ) -> Sequence[Axes]:
        """Draw channels over time [s], over the sample's number where there are no times; return the axes, one for each.

        Without names input and output are drawn, or all channels where nobody has said what these are. Raises `UsageError` for a
        name that no channel has.
        """
        known = [name for name in (self.input, self.output) if name is not None]
        chosen = names or known or [each.channel.name for each in self.series]
        panels = new_axes(axes, len(chosen), dark)
        for ax, series in zip(panels, [self[name] for name in chosen], strict=True):
            t = np.arange(len(series.values)) if series.t is None else series.t
            ax.plot(t, series.values, color=ground(dark).measured, linewidth=1.3)
            label = f"{series.channel.name} ({series.channel.unit or 'unit unknown'})"
            lay_out(ax, ground(dark), "sample" if series.t is None else "time (s)", label, "")
        return panels

"""A recording as a device: what was recorded is read again, sample by sample."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field

from servobench.core.channels import Array, DeviceInfo, Sample
from servobench.core.errors import DeviceError, FormatError, UsageError
from servobench.core.settings import Settings
from servobench.recordings.recording import Recording, Series, Stopped
from servobench.rig.devices.base import DEVICES, RunEnded, finite_voltage

SAME_SAMPLE_TIME = 0.01  # relative; clocks of different makers agree far better


class ReplaySettings(Settings):
    """The recording that is played."""

    file: Path
    """A native file (.mcap); other files have to be converted first."""
    recording: str | Annotated[int, Field(ge=0)] = 0
    """The name of one of its recordings, or its place, counted from 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Track:
    """The replayed samples: times (N,) [s] if there are any, counts, the input then, and sensors by their names."""

    t: Array | None
    counts: Array
    applied: Array
    sensors: dict[str, Array]

    def sample(self, index: int, sample_time: float) -> Sample:
        return Sample(
            index=index,
            time=index * sample_time if self.t is None else float(self.t[index]),
            counts=int(self.counts[index]),
            **{name: float(values[index]) for name, values in self.sensors.items()},
        )


@DEVICES.member("replay")
class Replay:
    """A recording played as a device: `read` gives its samples with their own times, and its end is the end of the run.

    Nothing can drive it. `write` takes a voltage, and returns the input that was applied back then: a run of it
    records what a controller would have commanded beside what happened, in the input's own unit.

    `source` is the recording, or the settings that say where it is. It needs an input, and an output in encoder counts or a
    channel `counts`; `tachometer` [rad/s] and `current` [A] are played where they have the times of the counts.
    Raises `UsageError` for a recording that can't be played, `FormatError` for a file that can't be read.
    """

    Settings: ClassVar[type[ReplaySettings]] = ReplaySettings
    drives: ClassVar[bool] = False
    """Nothing moves by what is written, so that a guard has nothing to stop."""

    def __init__(self, source: ReplaySettings | Recording) -> None:
        recording = source if isinstance(source, Recording) else _choose(source)
        counts = _counts(recording)
        driven = _input(recording)
        sensors = {
            name: recording[name] for name in ("tachometer", "current") if _is_played(recording, name, counts)
        }
        self._name = recording.name
        self._track = _Track(
            t=counts.t,
            counts=counts.values,
            applied=_input_at(recording, driven, counts),
            sensors={name: series.values for name, series in sensors.items()},
        )
        self._info = DeviceInfo(
            name="replay",
            serial=recording.info.serial if recording.info else "",
            channels=(
                replace(driven.channel, name="voltage"),
                replace(counts.channel, name="counts"),
                *(series.channel for series in sensors.values()),
            ),
            delay=recording.info.delay if recording.info else 0.0,
            timing="device",
            settings=(("recording", recording.name), ("source", recording.source.name)),
        )
        self._open = False
        self._sample_time = math.nan
        self._index = -1

    @property
    def info(self) -> DeviceInfo:
        """The channels that are played; the delay is that of the device that was recorded."""
        return self._info

    def __enter__(self) -> Self:
        """Get ready; nothing is connected."""
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Put the recording away."""
        self.stop()
        self._open = False

    def start(self, sample_time: float, seed: int | None) -> None:
        """Go back to the first sample; raises `UsageError` where the recording has another sample time [s]."""
        self._needs_open()
        if not (math.isfinite(sample_time) and sample_time > 0):
            raise UsageError(f"replay: the sample time is {sample_time!r}; expected a finite time above 0 s")
        t = self._track.t
        recorded = float(np.median(np.diff(t))) if t is not None and len(t) > 1 else sample_time
        if abs(recorded - sample_time) > SAME_SAMPLE_TIME * sample_time:
            raise UsageError(
                f"replay: the recording {self._name!r} has a sample time of {recorded:g} s, the run one of {sample_time:g} s; "
                f"give the run the recording's"
            )
        self._sample_time = sample_time
        self._index = -1

    def read(self) -> Sample:
        """Return the next sample; raises `RunEnded` after the last."""
        self._needs_open()
        if math.isnan(self._sample_time):
            raise UsageError("replay: read() came before start(); start a run first")
        if self._index + 1 >= len(self._track.counts):
            sentence = f"the replayed recording {self._name!r} ended after {len(self._track.counts)} samples"
            raise RunEnded(Stopped(reason="finished", sentence=sentence))
        self._index += 1
        return self._track.sample(self._index, self._sample_time)

    def write(self, voltage: float) -> float:
        """Return the input that was applied at the sample that was last read, whatever the voltage."""
        self._needs_open()
        finite_voltage("replay", voltage)
        if self._index < 0:
            raise UsageError("replay: write() came before the first read(); a tick reads first")
        return float(self._track.applied[self._index])

    def stop(self) -> None:
        """Stop: nothing moves anyway."""

    def _needs_open(self) -> None:
        if not self._open:
            raise DeviceError("the replay isn't open: use it inside a with statement")


def _choose(settings: ReplaySettings) -> Recording:
    """The recording that the settings name."""
    from servobench.recordings.native.reader import read

    try:
        recordings = read(settings.file)
    except FormatError as error:
        raise FormatError(
            f"{error}; a replay plays servobench's own files, so convert others first (servobench convert)"
        ) from None
    names = [recording.name for recording in recordings]
    if isinstance(settings.recording, str):
        places = [place for place, name in enumerate(names) if name == settings.recording]
    else:
        places = [settings.recording] if settings.recording < len(names) else []
    if len(places) == 1:
        return recordings[places[0]]
    listed = ", ".join(f"{place}: {name!r}" for place, name in enumerate(names))
    problem = "several recordings" if places else "no recording"
    raise UsageError(f"{settings.file} has {problem} {settings.recording!r}; it holds {listed}")


def _counts(recording: Recording) -> Series:
    """The channel that is played as an encoder."""
    name = "counts" if "counts" in recording else recording.output
    if name is None:
        raise UsageError(f"recording {recording.name!r} can't be replayed: its output channel isn't declared")
    series = recording[name]
    if series.channel.unit not in ("counts", "count"):
        raise UsageError(
            f"recording {recording.name!r} can't be replayed: {name!r} is in {series.channel.unit}, and a device "
            "reads encoder counts"
        )
    whole = np.isfinite(series.values) & (series.values == np.rint(series.values))
    if not whole.all():
        row = int(np.argmin(whole))
        raise UsageError(
            f"recording {recording.name!r} can't be replayed: in row {row + 1} {name!r} is {series.values[row]}, "
            "which isn't a whole number of counts"
        )
    return series


def _input(recording: Recording) -> Series:
    """The channel that is played as what was applied."""
    if recording.input is None:
        raise UsageError(f"recording {recording.name!r} can't be replayed: its input channel isn't declared")
    return recording[recording.input]


def _input_at(recording: Recording, driven: Series, counts: Series) -> Array:
    """The input at each sample of the counts: the value that holds from that time on."""
    if _same_times(driven, counts):
        return driven.values
    if driven.t is None or counts.t is None or (np.diff(driven.t) < 0).any():
        raise UsageError(
            f"recording {recording.name!r} can't be replayed: the times of its input and its counts can't be matched, "
            f"as one has none, or they don't increase"
        )
    before = recording.input_before
    first = driven.values[:1] if before is None else [before]
    held = np.concatenate([first, driven.values])
    if not len(held):
        raise UsageError(f"recording {recording.name!r} can't be replayed: its input has no samples")
    return held[np.searchsorted(driven.t, counts.t, side="right")]


def _is_played(recording: Recording, name: str, counts: Series) -> bool:
    """Whether there is a sensor of that name in the unit of samples and at the times of the counts."""
    unit = {"tachometer": "rad/s", "current": "A"}[name]
    return name in recording and recording[name].channel.unit == unit and _same_times(recording[name], counts)


def _same_times(one: Series, other: Series) -> bool:
    if one.t is None or other.t is None:
        return one.t is other.t and len(one.values) == len(other.values)
    return np.array_equal(one.t, other.t)

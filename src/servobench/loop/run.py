"""The verb `run`: an experiment carried out on a device. The only place where time passes."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from servobench._version import __version__
from servobench.channels import Array, Channel, DeviceInfo, Sample
from servobench.clock import Clock, Tick, clock_for
from servobench.devices.base import Device, RunEnded
from servobench.errors import DeviceError, DeviceLost, StorageError, UsageError
from servobench.experiment import Experiment
from servobench.finding import Finding, info, warning
from servobench.loop.recorder import InMemory, Recorder, ToFile
from servobench.recording.recording import Recording, Series, Source, Stopped
from servobench.signals.base import Signal

BLOCK_TIME = 0.5  # s; what a crash of the process may cost
BLOCK_ROWS = 4096  # the most rows in a block, for short sample times
REFERENCES = 512  # evaluated at once: a call of a signal costs far more than one more value in it
WATCH_INTERVAL = 0.1  # s of the run
LOOK_INTERVAL = 0.5  # s of the run
PATIENCE = 60.0  # s; how long a run in virtual time waits for a disk that's behind
MANY_MISSED = 0.01  # of all ticks


@dataclass(frozen=True, kw_only=True)
class Progress:
    """How far a run is: ticks done of all (None for an endless one), the time of the last one [s], and its values."""

    tick: int
    ticks: int | None
    time: float
    commanded: float
    applied: float
    counts: int


Watch: TypeAlias = Callable[[Progress], str | None]
"""Is shown the progress of a run; returns None, or the sentence with which the run is to stop. It holds the loop up."""

Look: TypeAlias = Callable[[Recording], str | None]
"""Is shown the recording so far; returns None, or the sentence with which the run is to end, as asked."""


def run(
    experiment: Experiment,
    device: Device,
    *,
    to: str | os.PathLike[str] | None = None,
    clock: Clock | None = None,
    watch: Watch | None = None,
    look: Look | None = None,
) -> Recording:
    """Carry out an experiment on a connected device, and return what happened.

    Each tick latches sample k at t_k, asks the controller, and writes u[k], which holds to t_k+1. The reference is the signal at
    the scheduled time. The recording has `commanded` (the controller's word), `applied` (what the device says it put out),
    `counts`, `tachometer` and `current` where the device has them, `scheduled` and `late`, all at the samples' actual times.

    With `to`, the recording is streamed to that native file as it happens, and read back at the end; an endless experiment needs
    it. `clock` is the one that the device asks for; a virtual device runs by any. `watch` is called ten times in a second, `look`
    twice; to look at the data holds the loop up, so that only a device in virtual time allows it.

    However it ends, the device is stopped first. The end of the experiment, Ctrl-C, a word from `watch`, the device's own
    (`RunEnded`) and a voltage that isn't finite are results: `stopped` says which. Raises `DeviceLost`, which carries the
    recording so far, where the device fails on the way; `StorageError` where nothing more can be written, what was written being
    kept; `UsageError` before anything moves. Any other error passes through, after the file is closed.
    """
    if experiment.duration is None and to is None:
        raise UsageError(
            "an endless experiment is recorded to a file, as no memory is large enough: give `to`"
        )
    if look is not None and device.info.timing != "virtual":
        raise UsageError(
            f"the device {device.info.name!r} runs by {device.info.timing} time, and looking at the data meanwhile would hold "
            "its loop up: run without `look` (--until), and longer"
        )
    keeper = _keeper(clock, device.info)
    references = _References(experiment.signal, experiment.sample_time)
    opening = _opening(experiment, device.info)
    try:
        device.start(experiment.sample_time, experiment.seed)
        recorder = _recorder(opening, to, keeper)
    except BaseException:
        _stop(device)
        raise
    so_far = None if look is None else InMemory(opening)
    log = _Log(recorder, _sensors(device.info), experiment.sample_time, so_far)
    try:
        stopped, error = _outcome(
            lambda: _carry_out(experiment, device, keeper, references, log, watch, look), device
        )
        if isinstance(error, StorageError):
            raise error
        recording = log.end(stopped)
    finally:
        recorder.abandon()
    if isinstance(error, DeviceError):
        raise DeviceLost(str(error), recording) from error
    if error is not None:
        raise error
    return recording


def _outcome(carry_out: Callable[[], Stopped], device: Device) -> tuple[Stopped, BaseException | None]:
    """Carry out a run and stop the device, whatever happens; return why it ended, and the error if it was one."""
    try:
        return carry_out(), None
    except KeyboardInterrupt:
        return Stopped(reason="interrupted", sentence="stopped from the keyboard"), None
    except RunEnded as end:
        return end.stopped, None
    except DeviceError as error:
        return Stopped(reason="device_lost", sentence=f"the device failed: {error}"), error
    except BaseException as error:
        return Stopped(reason="error", sentence=f"the run was ended by an error: {error!r}"), error
    finally:
        _stop(device)


def _stop(device: Device) -> None:
    """Stop the motor, also where Ctrl-C is pressed a second time meanwhile."""
    try:
        device.stop()
    except KeyboardInterrupt:
        device.stop()


def _carry_out(
    experiment: Experiment,
    device: Device,
    clock: Clock,
    references: _References,
    log: _Log,
    watch: Watch | None,
    look: Look | None,
) -> Stopped:
    """Let the ticks pass, one after the other, to the end of the experiment or to a fault; the device is started."""
    ticks = experiment.samples
    limit = experiment.limits.voltage
    controller = experiment.controller
    state = controller.start(experiment.sample_time)
    watching = watch or _nobody
    watch_every, watch_next = max(1, round(WATCH_INTERVAL / experiment.sample_time)), 0
    look_every = look_next = max(1, round(LOOK_INTERVAL / experiment.sample_time))
    due = 0
    clock.start(experiment.sample_time)
    while ticks is None or due < ticks:
        tick = clock.latch(due, device.read)
        due = tick.index + 1
        if ticks is not None and due > ticks:
            break
        reference = references[tick.index]
        if not math.isfinite(reference):
            return _fault(device, log, tick, reference, "the signal")
        state, voltage = controller.step(state, reference, tick.sample)
        commanded = float(voltage)
        if not math.isfinite(commanded):
            return _fault(device, log, tick, commanded, "the controller")
        applied = float(device.write(min(max(commanded, -limit), limit)))
        log.add(tick, commanded, applied)
        if tick.index >= watch_next:
            watch_next = tick.index + watch_every
            word = watching(_progress(tick, ticks, commanded, applied))
            if isinstance(word, str):
                return Stopped(reason="interrupted", sentence=word)
            if word is not None:
                raise UsageError(
                    f"watch returned {word!r}; expected None, or the sentence with which the run is to stop"
                )
        if look is not None and tick.index >= look_next:
            look_next = tick.index + look_every
            sentence = look(log.so_far())
            if sentence is not None:
                return Stopped(reason="finished", sentence=sentence)
    return Stopped(reason="finished", sentence=f"ran for {experiment.duration:g} s, as asked")


def _nobody(progress: Progress) -> None:
    """Watch, and let it run."""


def _progress(tick: Tick, ticks: int | None, commanded: float, applied: float) -> Progress:
    return Progress(
        tick=tick.index,
        ticks=ticks,
        time=tick.actual,
        commanded=commanded,
        applied=applied,
        counts=tick.sample.counts,
    )


def _fault(device: Device, log: _Log, tick: Tick, value: float, source: str) -> Stopped:
    """Put zero volts out in place of a value that is none, and record both."""
    log.add(tick, value, float(device.write(0.0)))
    sentence = f"{source} gave {value} at {tick.scheduled:g} s, which is no voltage; the motor was stopped"
    return Stopped(reason="fault", sentence=sentence)


class _References:
    """The reference at the scheduled time of each tick, in blocks; the first at once, as a mistake should show early."""

    def __init__(self, signal: Signal, sample_time: float) -> None:
        self._signal = signal
        self._sample_time = sample_time
        self._evaluate(0)

    def __getitem__(self, index: int) -> float:
        if not self._first <= index < self._first + REFERENCES:
            self._evaluate(index)
        return self._values[index - self._first]

    def _evaluate(self, first: int) -> None:
        t: Array = np.arange(first, first + REFERENCES, dtype=np.float64) * self._sample_time
        values = np.asarray(self._signal(t), dtype=np.float64)
        if values.shape != t.shape:
            raise UsageError(
                f"the signal {self._signal!r} gave shape {values.shape} for times of shape {t.shape}"
            )
        self._first = first
        self._values: list[float] = values.tolist()


class _Log:
    """Gathers the ticks of a run in blocks for the recorder, and keeps account of lateness."""

    def __init__(
        self,
        recorder: Recorder,
        sensors: tuple[str, ...],
        sample_time: float,
        kept: InMemory | None = None,
    ) -> None:
        self._recorder = recorder
        self._kept = kept
        self._sensors = sensors
        self._block = max(1, min(BLOCK_ROWS, int(BLOCK_TIME / sample_time)))
        self._rows: list[tuple[float, ...]] = []
        self._due = 0
        self._done = 0
        self._late = 0
        self._missed = 0
        self._worst = 0.0

    def add(self, tick: Tick, commanded: float, applied: float) -> None:
        """Take one tick: the columns are those of `_opening`, after the time."""
        measured = self._measured(tick.sample) if self._sensors else ()
        self._rows.append(
            (tick.actual, commanded, applied, tick.sample.counts, *measured, tick.scheduled, tick.late)
        )
        self._done += 1
        self._missed += tick.index - self._due
        self._due = tick.index + 1
        if tick.late:
            self._late += 1
            self._worst = max(self._worst, tick.actual - tick.scheduled)
        if len(self._rows) >= self._block:
            self._flush()

    def so_far(self) -> Recording:
        """Hand on what is left, and return the recording so far; only where the log keeps it."""
        if self._kept is None:
            raise UsageError("this run keeps no recording to look at: give `look`")
        if self._rows:
            self._flush()
        return self._kept.end(Stopped(reason="unknown", sentence="the run goes on"), self._findings())

    def end(self, stopped: Stopped) -> Recording:
        """Hand on what is left, and return the recording with what was found."""
        if self._rows:
            self._flush()
        return self._recorder.end(stopped, self._findings())

    def _measured(self, sample: Sample) -> list[float]:
        values = [getattr(sample, name) for name in self._sensors]
        return [math.nan if value is None else value for value in values]

    def _flush(self) -> None:
        # Away with the rows first: an interruption in the middle may lose a block at the end, but never doubles one.
        rows, self._rows = self._rows, []
        block = np.array(rows, dtype=np.float64)
        self._recorder.append(block)
        if self._kept is not None:
            self._kept.append(block)

    def _findings(self) -> tuple[Finding, ...]:
        findings = []
        if self._late:
            findings.append(
                info(
                    "samples-late",
                    f"{self._late} of {self._done} samples were late, by up to {1000 * self._worst:.3g} ms; "
                    f"their actual times are recorded, and used",
                )
            )
        if self._missed:
            all_ticks = self._done + self._missed
            tell = warning if self._missed > MANY_MISSED * all_ticks else info
            findings.append(
                tell(
                    "samples-missed",
                    f"{self._missed} of {all_ticks} samples were missed, as the computer or the device was busy elsewhere; "
                    f"the input before each gap held through it",
                )
            )
        return tuple(findings)


def _recorder(opening: Recording, to: str | os.PathLike[str] | None, clock: Clock) -> Recorder:
    """Where the rows go. A loop that keeps up with a turning motor doesn't wait for a disk, one in virtual time may."""
    if to is None:
        return InMemory(opening)
    return ToFile(opening, to, patience=PATIENCE if clock.timing == "virtual" else 0.0)


def _keeper(clock: Clock | None, device: DeviceInfo) -> Clock:
    """The clock of a run; raises where it isn't the one that the device runs by."""
    if clock is None:
        return clock_for(device.timing)
    if device.timing not in ("virtual", clock.timing):
        raise UsageError(
            f"the device {device.name!r} runs by {device.timing} time, the clock that was given keeps {clock.timing} time; "
            f"leave the clock out"
        )
    return clock


def _sensors(device: DeviceInfo) -> tuple[str, ...]:
    """The fields of a sample, beside its counts, that the device has."""
    return tuple(name for name in ("tachometer", "current") if device.channel(name))


def _opening(experiment: Experiment, device: DeviceInfo) -> Recording:
    """What is known of the recording before its first sample, with a series for each column."""
    voltage = device.channel("voltage") or Channel(name="voltage", unit="V")
    channels = [
        Channel(name="commanded", unit=voltage.unit),
        replace(voltage, name="applied"),
        device.channel("counts") or Channel(name="counts", unit="counts"),
        *(channel for name in _sensors(device) if (channel := device.channel(name))),
        Channel(name="scheduled", unit="s"),
        Channel(name="late", unit="1", minimum=0.0, maximum=1.0, resolution=1.0),
    ]
    nothing = np.empty(0)
    return Recording(
        name=experiment.name or "run",
        series=tuple(Series(channel=channel, values=nothing, t=nothing) for channel in channels),
        source=Source(name=device.name),
        input="applied",
        output="counts",
        input_before=0.0,
        info=device,
        experiment=experiment.to_toml(),
        versions={"servobench": __version__, "python": platform.python_version(), "numpy": np.__version__},
    )

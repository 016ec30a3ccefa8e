"""The verb `run`: an experiment carried out on a device in this process. Time passes here and in the loop's own process only."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

from servobench.core.arguments import check_type
from servobench.core.channels import DeviceInfo
from servobench.core.errors import DeviceError, StorageError, UsageError
from servobench.recordings.recording import Recording, Stopped
from servobench.rig.clock import Clock, clock_for
from servobench.rig.devices.base import Device
from servobench.rig.devices.guarded import Guarded
from servobench.rig.experiment import Experiment
from servobench.rig.loop.account import Account
from servobench.rig.loop.clock_steps import ClockSteps
from servobench.rig.loop.log import Log, block_of
from servobench.rig.loop.missed_ticks import MissedTickRule
from servobench.rig.loop.opening import opening, row_maker
from servobench.rig.loop.place import Place
from servobench.rig.loop.preloading import preload
from servobench.rig.loop.recorder import InMemory, Recorder, ToFile
from servobench.rig.loop.references import References
from servobench.rig.loop.ticks import Attendant, Drive, now_and_then, outcome, run_ticks, stop
from servobench.rig.lost_device import DeviceLost

WATCH_INTERVAL = 0.1  # s of the run
LOOK_INTERVAL = 0.5  # s of the run
PATIENCE = 60.0  # s; how long a run in virtual time waits for a disk that's behind


@dataclass(frozen=True, kw_only=True)
class Progress:
    """The progress of a run: ticks done of all (None for an endless one), the time of the last one [s], and its values.

    `commanded` and `applied` are its voltages [V], `counts` the encoder's.
    """

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


@runtime_checkable
class _Runnable(Protocol):
    """The parts of an experiment that a run needs to begin; others are read where they are used."""

    @property
    def signal(self) -> object: ...

    @property
    def sample_time(self) -> float: ...


def run(
    experiment: Experiment,
    device: Device,
    *,
    to: str | os.PathLike[str] | None = None,
    clock: Clock | None = None,
    watch: Watch | None = None,
    look: Look | None = None,
) -> Recording:
    """Carry out an experiment on a connected device, and return the recording.

    Each tick latches sample k at t_k, computes the controller's voltage u[k] and writes it; it holds to
    t_k+1. The reference is the signal at the scheduled time. The recording has `commanded` (the controller's
    voltage), `applied` (the voltage that the device reports), `counts`, `tachometer` and `current` if the
    device has them, `scheduled`, `late` and `saturated` (changed by a limit). In real time it also has
    `handed` and `written` (the beginning and the return of the write, by the host's clock), and `latched`
    (the device's own time of the sample, if the host keeps the time) or `received` (the host's, if the device
    does); with a controller, its `reference`. All are at the samples' actual times.

    With `to`, the recording is streamed to that native file during the run, and read when you first look at
    its samples; an endless experiment needs it. `clock` is by default the one that the device needs; a virtual device runs by
    any. `watch` is called ten times per second, `look` twice. Looking at the data holds the loop up, so only
    a device in virtual time allows `look`.

    In virtual time a run of parts that are all built in is compiled, 0.05 to 0.3 µs a tick; with a device,
    controller or monitor of your own it goes tick by tick, 15 to 20 µs each, with the same results.

    However the run ends, the device is stopped first. The end of the experiment, Ctrl-C, a stop by `watch` or
    by the device (`RunEnded`) and a voltage that isn't finite are results: `stopped` says which. Raises
    `DeviceLost`, with the recording so far, if the device fails during the run; `StorageError` if nothing
    more can be written, what was written being kept; `UsageError` before anything moves. Any other error
    passes through after the file is closed.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> len(recording["counts"].values)
    1500
    """
    check_type(
        "experiment", experiment, _Runnable, 'an Experiment, such as servobench.Experiment(duration="5 s")'
    )
    _check(experiment, device)
    if experiment.duration is None and to is None:
        raise UsageError(
            "an endless experiment doesn't fit into memory and must be recorded to a file: give `to`"
        )
    if look is not None and device.info.timing != "virtual":
        raise UsageError(
            f"the device {device.info.name!r} runs by {device.info.timing} time, and looking at the data during the "
            "run would delay its loop: leave `look` (`until=...`) out, and run longer"
        )
    device = device if isinstance(device, Guarded) else Guarded(device, experiment.limits)
    preload(device, experiment)
    keeper = _keeper(clock, device.info, experiment)
    references = References(experiment.signal, experiment.sample_time)
    opened = opening(experiment, device.info, timing=keeper.timing)
    steps = ClockSteps(experiment.sample_time)
    try:
        drive = Drive(experiment, device, references)
        recorder = _recorder(opened, to, keeper, experiment.samples)
    except BaseException:
        stop(device)
        raise
    log = Log(
        recorder,
        row_maker(opened),
        Account(experiment.sample_time, keeper.timing),
        block_of(experiment.sample_time),
        None if look is None else InMemory(opened, experiment.samples or 0),
    )
    attendants = (
        *((steps,) if keeper.timing != "host" else ()),
        MissedTickRule(experiment.sample_time),
        *_attendants(experiment, log, watch, look),
    )
    try:
        # Last: from here on a board that keeps the time sends samples, whether or not they are read.
        device.start(experiment.sample_time, experiment.seed)
    except BaseException:
        stop(device)
        recorder.discard()
        raise
    try:
        stopped, error = outcome(
            lambda: _carry_out(experiment, device, keeper, drive, log, attendants), device
        )
        if isinstance(error, StorageError):
            raise error
        recording = log.end(stopped, (*opened.findings, *device.findings(), *steps.findings()))
    finally:
        recorder.abandon()
    if isinstance(error, DeviceError):
        raise DeviceLost(str(error), recording) from error
    if error is not None:
        raise error
    return recording


def _check(experiment: object, device: object) -> None:
    """Raise `UsageError` if the arguments aren't an experiment and a device."""
    if getattr(experiment, "signal", None) is None:  # what is like an experiment will do
        raise UsageError(
            f"{experiment!r} isn't an experiment; expected an Experiment, such as servobench.Experiment(duration='5 s')"
        )
    if getattr(device, "info", None) is None:
        raise UsageError(
            f"{device!r} isn't a device; expected one, such as connect('twin') in a with statement"
        )


def _carry_out(
    experiment: Experiment,
    device: Guarded,
    clock: Clock,
    drive: Drive,
    log: Log,
    attendants: tuple[Attendant, ...],
) -> Stopped:
    """Let the ticks pass to the end of the experiment or to a fault; the device is started."""
    clock.start(experiment.sample_time)
    ended = run_ticks(experiment.samples, device, clock, drive, log, attendants)
    if ended is None:
        log.complete(experiment.samples)
    return ended or Stopped(reason="finished", sentence=f"ran for {experiment.duration:g} s, as asked")


def _attendants(
    experiment: Experiment, log: Log, watch: Watch | None, look: Look | None
) -> tuple[Attendant, ...]:
    """Those who are shown the ticks, each at its own pace."""
    ticks = experiment.samples
    attendants: list[Attendant] = []
    if watch is not None:
        attendants.append(
            now_and_then(
                WATCH_INTERVAL, experiment.sample_time, lambda place: _call_watch(watch, place, ticks)
            )
        )
    if look is not None:
        every = max(1, round(LOOK_INTERVAL / experiment.sample_time))
        attendants.append(
            now_and_then(
                LOOK_INTERVAL, experiment.sample_time, lambda place: _call_look(look, log.so_far()), every
            )
        )
    return tuple(attendants)


def _call_watch(watch: Watch, place: Place, ticks: int | None) -> Stopped | None:
    word = watch(
        Progress(
            tick=place.tick.index,
            ticks=ticks,
            time=place.tick.actual,
            commanded=place.commanded,
            applied=place.applied,
            counts=place.tick.sample.counts,
        )
    )
    if word is None:
        return None
    if isinstance(word, str):
        return Stopped(reason="interrupted", sentence=word)
    raise UsageError(f"watch returned {word!r}; expected None, or a sentence saying why to stop the run")


def _call_look(look: Look, so_far: Recording) -> Stopped | None:
    sentence = look(so_far)
    return None if sentence is None else Stopped(reason="finished", sentence=sentence)


def _recorder(
    opened: Recording, to: str | os.PathLike[str] | None, clock: Clock, samples: int | None
) -> Recorder:
    """The recorder of the rows. A loop that keeps up with a turning motor doesn't wait for a disk, one in virtual time may."""
    if to is None:
        return InMemory(opened, samples or 0)
    return ToFile(opened, to, patience=PATIENCE if clock.timing == "virtual" else 0.0)


def _keeper(clock: Clock | None, device: DeviceInfo, experiment: Experiment) -> Clock:
    """The clock of a run; raises where it isn't the one that the device runs by."""
    if clock is None:
        return clock_for(device.timing, missed=experiment.when_late.missed, phase=experiment.when_late.phase)
    if device.timing not in ("virtual", clock.timing):
        raise UsageError(
            f"the device {device.name!r} runs by {device.timing} time, but the given clock keeps {clock.timing} "
            "time; leave the clock out"
        )
    return clock

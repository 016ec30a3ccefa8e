"""The ticks of a run: wait, latch, compute the voltage, write it, pass the row on; the same in every process."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol, TypeAlias

from servobench.core.channels import Array, Sample
from servobench.core.errors import DeviceError, UsageError
from servobench.recordings.recording import Stopped
from servobench.rig.clock import Clock, Tick
from servobench.rig.devices.base import Device, RunEnded, value_text, voltage_or_nan
from servobench.rig.devices.guard.base import Alarm
from servobench.rig.devices.guarded import Guarded
from servobench.rig.experiment import Experiment
from servobench.rig.loop.blocks.block_pass import BlockPass
from servobench.rig.loop.place import Place
from servobench.rig.loop.references import References
from servobench.systems.control.base import Controller, State
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.signals.base import Signal


class Sink(Protocol):
    """The receiver of the ticks."""

    def add(self, place: Place) -> None:
        """Take one tick that is done; doesn't wait."""
        ...


Attendant: TypeAlias = Callable[[Place], Stopped | None]
"""Is shown each tick once it's done; returns None, or why the run is to end. It holds the loop up."""


class Change(Protocol):
    """A change of a run in progress; None leaves a part unchanged."""

    @property
    def number(self) -> int:
        """Its number; a later one is higher."""
        ...

    @property
    def signal(self) -> Signal | None:
        """The new reference; its time begins there."""
        ...

    @property
    def controller(self) -> Controller | None:
        """The new controller."""
        ...

    @property
    def enabled(self) -> bool | None:
        """Whether the controller's voltage is applied from then on."""
        ...


class Drive:
    """The present driver of the motor: a signal, a controller with its state, and whether its voltage is passed on.

    `change` takes effect at the next tick, and without a bump where the controller's law can take over. What can't be taken over
    stays as it was; `refused` says why, by the change's number. `command` is the number of the last change in force.
    """

    def __init__(
        self, experiment: Experiment, device: Guarded, references: References, *, enabled: bool = True
    ) -> None:
        self._sample_time = experiment.sample_time
        self._device = device
        self._info = device.info.with_limit(experiment.limits.voltage)
        self._references = references
        self._controller: Controller = experiment.controller
        self._state: State = self._controller.start(experiment.sample_time, self._info)
        self._enabled = enabled
        self._changes: deque[Change] = deque()
        self._last = 0.0
        self.command = 0
        self.returned: object = 0.0
        """The controller's last return value: its voltage, or the whole value if it was no pair."""
        self.expected = "a finite number in V"
        self._watch_the_sign()
        self.refused: dict[int, str] = {}

    @property
    def enabled(self) -> bool:
        """Whether the controller's voltage is applied."""
        return self._enabled

    @property
    def controller(self) -> Controller:
        """The control law in force."""
        return self._controller

    @property
    def state(self) -> State:
        """The control law's state."""
        return self._state

    @property
    def is_steady(self) -> bool:
        """Whether the controller's voltage is applied, and no change waits."""
        return self._enabled and not self._changes

    def references(self, index: int) -> Array:
        """Return the references (N,) from that tick on, as many as are evaluated at once."""
        return self._references.block(index)

    def pass_to(self, state: State, voltage: float) -> None:
        """Take the control law's state after a block of ticks, and the voltage [V] that it commanded last."""
        self._state, self.returned, self._last = state, voltage, voltage

    def change(self, change: Change) -> None:
        """Let it take effect at the next tick."""
        self._changes.append(change)

    def voltage(self, tick: Tick) -> tuple[float, float]:
        """Return the reference and the voltage that the controller commands for it [V]; 0 V where it isn't let through."""
        while self._changes:
            self._take_effect(self._changes.popleft(), tick)
        reference = self._references.at(tick)
        commanded = 0.0
        if self._enabled and math.isfinite(reference) and self._device.usable:
            commanded = self._law_voltage(reference, tick.sample)
        self._last = commanded
        return reference, commanded

    def _law_voltage(self, reference: float, sample: Sample) -> float:
        """The controller's voltage [V]: the device's word where that computes the law by itself."""
        if self._device.law is not None and self._device.law is self._controller:
            return self._device.follow(reference)
        return self._take_step(self._controller.step(self._state, reference, sample))

    def _take_step(self, step: object) -> float:
        """Take what a controller's step returned: the next state, and the voltage [V], NaN where it is none."""
        if not (isinstance(step, tuple) and len(step) == 2):
            self.returned, self.expected = step, "the pair (state, voltage)"
            return math.nan
        self._state, self.returned = step
        return voltage_or_nan(self.returned)

    def _take_effect(self, change: Change, tick: Tick) -> None:
        self.command = change.number
        try:
            references = (
                self._references
                if change.signal is None
                else References(change.signal, self._sample_time, tick)
            )
            controller = change.controller or self._controller
            if change.controller is not None or change.enabled is not None:
                self._device.take_law(None, self._sample_time)
            enabled = self._enabled if change.enabled is None else change.enabled
            if change.controller is not None or enabled > self._enabled:
                unwrapped = replace(tick.sample, counts=self._device.unwrapped)
                self._state = controller.take_over(
                    self._sample_time, self._info, references.at(tick), unwrapped, self._last
                )
        except UsageError as error:
            self.refused[change.number] = str(error)
            return
        self._references, self._controller, self._enabled = references, controller, enabled
        self._watch_the_sign()

    def _watch_the_sign(self) -> None:
        """Have the guard watch the encoder's sign where a controller answers to it."""
        self._device.under_feedback(self._enabled and not isinstance(self._controller, OpenLoop))


def run_ticks(
    ticks: int | None,
    device: Guarded,
    clock: Clock,
    drive: Drive,
    sink: Sink,
    attendants: Sequence[Attendant],
) -> Stopped | None:
    """Let the ticks pass, one after the other, until they are done (None), or something ends the run.

    The device and the clock are started. A value that isn't finite, commanded or measured, is recorded, with zero volts in its
    place, and is a fault.
    """
    if clock.timing == "host":  # otherwise the samples' own time is the run's
        device.set_clock(clock.elapsed)
    due, latch = 0, _Latch(device)
    block = BlockPass.of(device, clock, drive, sink, attendants, ticks)
    while ticks is None or due < ticks:
        if block is not None and (due := block.advance(due, ticks)) == ticks:
            break
        tick = clock.latch(due, latch)
        received = clock.elapsed() if clock.timing == "device" else math.nan
        due = tick.index + 1
        if ticks is not None and due > ticks:
            break
        reference, commanded = drive.voltage(tick)
        if latch.stopped is not None:
            sink.add(_stop_place(tick, reference, device.applied, drive.command, clock.elapsed()))
            return latch.stopped
        finite = math.isfinite(reference) and math.isfinite(commanded)
        handed = clock.elapsed()
        applied = device.write(commanded if finite else 0.0)
        place = Place(
            tick=tick,
            reference=reference,
            commanded=commanded if math.isfinite(reference) else reference,
            applied=applied,
            saturated=device.saturated or not finite,
            received=received,
            handed=handed,
            written=clock.elapsed(),
            command=drive.command,
        )
        sink.add(place)
        if not finite and (stopped := device.refuse(_no_voltage(place, drive))) is not None:
            return stopped
        for attendant in attendants:
            if (stopped := attendant(place)) is not None:
                return stopped
    return None


class _Latch:
    """Reads a device, and keeps the run's end that came with a sample until that sample is recorded."""

    def __init__(self, device: Guarded) -> None:
        self._read = device.read
        self.stopped: Stopped | None = None

    def __call__(self) -> Sample:
        try:
            return self._read()
        except RunEnded as end:
            if end.sample is None:
                raise
            self.stopped = end.stopped
            return end.sample


def _stop_place(tick: Tick, reference: float, applied: float, command: int, now: float) -> Place:
    """The tick of a sample that ended the run: nothing was commanded; the guard's voltage [V] was put out by `now` [s]."""
    return Place(
        tick=tick,
        reference=reference,
        commanded=0.0,
        applied=applied,
        saturated=applied != 0.0,
        received=now,
        handed=now,
        written=now,
        command=command,
    )


def _no_voltage(place: Place, drive: Drive) -> Alarm:
    if not math.isfinite(place.reference):
        return Alarm("not-a-voltage", f"the signal gave {place.reference}, which isn't a voltage")
    return Alarm(
        "not-a-voltage",
        f"the controller returned {value_text(drive.returned)}, which isn't a voltage; expected {drive.expected}",
    )


def now_and_then(interval: float, sample_time: float, attendant: Attendant, first: int = 0) -> Attendant:
    """Return what shows an attendant one tick in each interval [s of the run], from the tick `first` on."""
    return NowAndThen(max(1, round(interval / sample_time)), attendant, first)


class NowAndThen:
    """Shows an attendant one tick of `every` so many; `due` is the number of the next."""

    def __init__(self, every: int, attendant: Attendant, first: int) -> None:
        self._every = every
        self._attendant = attendant
        self.due = first

    def __call__(self, place: Place) -> Stopped | None:
        """Show the tick, if it is time."""
        if place.tick.index < self.due:
            return None
        self.due = place.tick.index + self._every
        return self._attendant(place)

    def pass_to(self, tick: Tick) -> None:
        """Do nothing: it wasn't time."""


def outcome(carry_out: Callable[[], Stopped], device: Device) -> tuple[Stopped, BaseException | None]:
    """Carry out a run and stop the device, whatever happens; return why it ended, and the error if it was one."""
    try:
        return carry_out(), None
    except KeyboardInterrupt as interrupt:
        return Stopped(reason="interrupted", sentence=stop_text(interrupt)), None
    except RunEnded as end:
        return end.stopped, None
    except DeviceError as error:
        return Stopped(reason="device_lost", sentence=f"the device failed: {error}"), error
    except BaseException as error:
        return Stopped(reason="error", sentence=f"the run was ended by an error: {error!r}"), error
    finally:
        stop(device)


def stop_text(interrupt: KeyboardInterrupt) -> str:
    """Return who stopped a run, as a sentence: the keyboard, or the request to end that stands in the interrupt."""
    return f"stopped by {interrupt}" if interrupt.args else "stopped from the keyboard"


def stop(device: Device) -> None:
    """Stop the motor, also where Ctrl-C is pressed a second time meanwhile."""
    try:
        device.stop()
    except KeyboardInterrupt:
        device.stop()

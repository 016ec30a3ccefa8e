"""The ticks of a run: wait, latch, ask the controller, put the voltage out, hand on. Whoever runs it, and wherever."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

from servobench.clock import Clock, Tick
from servobench.control.base import Controller, State
from servobench.devices.base import Device, RunEnded
from servobench.errors import DeviceError
from servobench.experiment import Experiment
from servobench.loop.place import Place
from servobench.loop.references import References
from servobench.recording.recording import Stopped


class Sink(Protocol):
    """Where the ticks go."""

    def add(self, place: Place) -> None:
        """Take one tick that is done; doesn't wait."""
        ...


Attendant: TypeAlias = Callable[[Place], Stopped | None]
"""Is shown each tick once it's done; returns None, or why the run is to end. It holds the loop up."""


class Drive:
    """What drives the motor at the moment: a signal, a controller with its state, and whether it is let through.

    In a live run commands change it between two ticks; a change takes effect at the tick after.
    """

    def __init__(self, experiment: Experiment, references: References) -> None:
        self.references = references
        self.controller: Controller = experiment.controller
        self.state: State = self.controller.start(experiment.sample_time)
        self.enabled = True
        self.command = 0

    def voltage(self, tick: Tick) -> tuple[float, float]:
        """Return the reference and the voltage that the controller commands for it [V]; 0 V where it isn't let through."""
        reference = self.references[tick.index]
        if not self.enabled or not math.isfinite(reference):
            return reference, 0.0
        self.state, voltage = self.controller.step(self.state, reference, tick.sample)
        return reference, float(voltage)


def let_pass(
    ticks: int | None,
    limit: float,
    device: Device,
    clock: Clock,
    drive: Drive,
    sink: Sink,
    attendants: Sequence[Attendant],
) -> Stopped | None:
    """Let the ticks pass, one after the other, until they are done (None), or something ends the run.

    The device and the clock are started. A value that isn't finite is recorded, with zero volts in its place, and ends the run.
    """
    due = 0
    while ticks is None or due < ticks:
        tick = clock.latch(due, device.read)
        due = tick.index + 1
        if ticks is not None and due > ticks:
            break
        reference, commanded = drive.voltage(tick)
        finite = math.isfinite(reference) and math.isfinite(commanded)
        applied = float(device.write(min(max(commanded, -limit), limit) if finite else 0.0))
        place = Place(
            tick=tick,
            reference=reference,
            commanded=commanded if math.isfinite(reference) else reference,
            applied=applied,
            saturated=applied != commanded,
            command=drive.command,
        )
        sink.add(place)
        if not finite:
            return _no_voltage(place)
        for attendant in attendants:
            if (stopped := attendant(place)) is not None:
                return stopped
    return None


def _no_voltage(place: Place) -> Stopped:
    source = "the controller" if math.isfinite(place.reference) else "the signal"
    return Stopped(
        reason="fault",
        sentence=f"{source} gave {place.commanded} at {place.tick.scheduled:g} s, which is no voltage; the motor was stopped",
    )


def outcome(carry_out: Callable[[], Stopped], device: Device) -> tuple[Stopped, BaseException | None]:
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
        stop(device)


def stop(device: Device) -> None:
    """Stop the motor, also where Ctrl-C is pressed a second time meanwhile."""
    try:
        device.stop()
    except KeyboardInterrupt:
        device.stop()

"""The description of a run's recording before its first sample, and the contents of its rows."""

from __future__ import annotations

import math
import platform
from dataclasses import replace

import numpy as np

from servobench._version import __version__
from servobench.core.channels import Channel, DeviceInfo, Timing
from servobench.recordings.recording import Recording, Series, Source
from servobench.rig.devices.faulty import injection_findings
from servobench.rig.experiment import Experiment
from servobench.rig.loop.place import Place
from servobench.systems.control.open_loop import OpenLoop

_SENSORS = ("tachometer", "current", "held_since")  # fields of a sample, beside its counts


def sensors(device: DeviceInfo) -> tuple[str, ...]:
    """The fields of a sample, beside its counts, that the device has."""
    return tuple(name for name in _SENSORS if device.channel(name))


def opening(
    experiment: Experiment, device: DeviceInfo, *, commanded_live: bool = False, timing: Timing = "virtual"
) -> Recording:
    """Return the recording of a run without its samples: a series for each column of its rows, after the time.

    A run with a controller, and one that takes commands meanwhile (`commanded_live`), has the reference [V, rad or rad/s] too;
    the latter also the number of the last command in force. One in real time (`timing`) notes when the device was given each
    voltage and when it had taken it [s], by the host's clock. Where the device keeps the time, the host's time at which each
    sample was received [s] is noted, too; where it keeps the host's, when it latched each sample, in its own count [s].
    """
    voltage = device.channel("voltage") or Channel(name="voltage", unit="V")
    controlled = not isinstance(experiment.controller, OpenLoop)
    channels = [
        Channel(name="commanded", unit=voltage.unit),
        replace(voltage, name="applied"),
        device.channel("counts") or Channel(name="counts", unit="counts"),
        *(channel for name in sensors(device) if (channel := device.channel(name))),
        Channel(name="scheduled", unit="s"),
        _flag("late"),
        _flag("saturated"),
    ]
    if timing != "virtual":
        channels += [Channel(name="handed", unit="s"), Channel(name="written", unit="s")]
        if device.timing == "host":
            channels.append(Channel(name="latched", unit="s"))
        elif device.timing == "device":
            channels.append(Channel(name="received", unit="s"))
    if controlled or commanded_live:
        channels.append(Channel(name="reference", unit=experiment.controller.reference_unit))
    if commanded_live:
        channels.append(Channel(name="command", unit="1", minimum=0.0, resolution=1.0))
    nothing = np.empty(0)
    return Recording(
        name=experiment.name or "run",
        series=tuple(Series(channel=channel, values=nothing, t=nothing) for channel in channels),
        source=Source(name=device.name),
        input="applied",
        output="counts",
        reference="reference" if controlled else None,
        input_before=_input_before(experiment, timing),
        info=device,
        experiment=experiment.to_toml(),
        findings=injection_findings(
            device
        ),  # from the start, so that a recording that is cut short is marked, too
        versions={"servobench": __version__, "python": platform.python_version(), "numpy": np.__version__},
    )


def _input_before(experiment: Experiment, timing: Timing) -> float:
    """The voltage that held before the first sample: a device that keeps the time holds the start value for a tick until then."""
    return experiment.limits.start_voltage(experiment.sample_time) if timing == "device" else 0.0


def _flag(name: str) -> Channel:
    return Channel(name=name, unit="1", minimum=0.0, maximum=1.0, resolution=1.0)


def row_maker(opened: Recording) -> RowMaker:
    """Return what makes the rows of that recording."""
    return RowMaker(tuple(series.channel.name for series in opened.series))


class RowMaker:
    """Makes the row of a tick: its time [s] and a value for each channel, in the channels' order."""

    def __init__(self, channels: tuple[str, ...]) -> None:
        self._sensors = tuple(name for name in _SENSORS if name in channels)
        self._written = "written" in channels
        self._latched = "latched" in channels
        self._received = "received" in channels
        self._reference = "reference" in channels
        self._command = "command" in channels

    def __call__(self, place: Place) -> tuple[float, ...]:
        """Return the row of a tick, in the order of the channels."""
        tick = place.tick
        sample = tick.sample
        row: tuple[float, ...] = (tick.actual, place.commanded, place.applied, sample.counts)
        for name in self._sensors:
            value = getattr(sample, name)
            row += (math.nan if value is None else value,)
        row += (tick.scheduled, tick.late, place.saturated)
        if self._written:
            row += (place.handed, place.written)
        if self._latched:
            row += (sample.time,)
        if self._received:
            row += (place.received,)
        if self._reference:
            row += (place.reference,)
        if self._command:
            row += (place.command,)
        return row

"""Runs beside the exercise's own: of a simulated motor with other hidden truths, and of the motor at a constant speed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.lab.studies.base import Stand
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.systems.filters.base import SpeedEstimate

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording
    from servobench.rig.devices.faults.base import Fault

SETTLING = 2.0  # s; twenty time constants of a motor of 0.1 s
STEADY = 4.0  # s that are examined


def simulate_run(experiment: Experiment, faults: Sequence[Fault] = (), **settings: object) -> Recording:
    """Carry out an experiment on a twin in virtual time, and return what happened.

    `settings` are the twin's, and go before those that the experiment gives a twin; `faults` are injected. Raises `UsageError`
    for settings that the twin hasn't.
    """
    from servobench.rig.devices.base import connect
    from servobench.rig.devices.faulty import Faulty
    from servobench.rig.loop.run import run

    own = experiment.device.settings if experiment.device.name == "twin" else {}
    chosen = {**own, **settings, "timing": "virtual"}
    made = experiment.model_copy(update={"device": DeviceChoice(name="twin", settings=chosen)})
    twin = connect("twin", **chosen)
    with Faulty(twin, faults) if faults else twin as motor:
        return run(made, motor)


@dataclass(frozen=True, kw_only=True, eq=False)
class SteadyRun:
    """A motor that turned at a constant speed [rad/s]: its data, and the first sample at which the speed was constant."""

    data: Dataset
    speed: float
    first: int

    @property
    def quantum(self) -> float:
        """The encoder's step [rad]."""
        return quantum_of(self.data)

    def noise(self, estimate: SpeedEstimate) -> float:
        """Return the rms difference of a speed estimate from the constant speed [rad/s]."""
        off = estimate(self.data.y, self.data.t_output)[self.first :] - self.speed
        return float(np.sqrt(np.mean(off**2)))


def steady_run(stand: Stand, voltage: float, sample_time: float) -> SteadyRun:
    """Return a run of the stand's motor at a constant voltage [V]; its speed is the slope of all its steady positions.

    Over 4 s that is right to Δ √(12/N)/(4 s √12), which follows from the variance of a line's slope: a ten-thousandth of a
    count a sample at 500 Hz. Raises `UsageError` where the motor stands still.
    """
    from servobench.systems.control.open_loop import OpenLoop
    from servobench.systems.signals.constant import Constant

    experiment = stand.experiment.model_copy(
        update={
            "name": f"{stand.experiment.name} at {voltage:g} V",
            "signal": Constant(value=voltage),
            "controller": OpenLoop(),
            "duration": SETTLING + STEADY,
            "sample_time": sample_time,
            "until": "",
        }
    )
    data = measure(stand.run(experiment))
    steady = data.t_output >= data.t_output[0] + SETTLING
    speed = _slope(data.t_output[steady], data.y[steady])
    if abs(speed) * sample_time < 1e-3 * quantum_of(data):
        raise UsageError(f"the motor stands still at {voltage:g} V; use a voltage that turns it")
    return SteadyRun(data=data, speed=speed, first=int(np.argmax(steady)))


def quantum_of(data: Dataset) -> float:
    """Return the step of a position [rad]; raises `UsageError` where the data have none, or are no position in rad."""
    if data.quantum is None or data.kind != "position" or data.output_unit != "rad":
        raise UsageError(
            f"{data.name} is a {data.kind} in {data.output_unit}; expected an encoder's counts, with known counts "
            "per turn"
        )
    return data.quantum


def top_level(stand: Stand) -> float:
    """Return the highest voltage [V] of the exercise's signal."""
    duration = stand.experiment.duration or SETTLING
    count = min(math.ceil(duration / stand.experiment.sample_time), 100_000)
    return float(
        np.max(stand.experiment.signal(stand.experiment.sample_time * np.arange(count, dtype=np.float64)))
    )


def _slope(t: Array, x: Array) -> float:
    since = t - t.mean()
    return float(since @ (x - x.mean()) / (since @ since))

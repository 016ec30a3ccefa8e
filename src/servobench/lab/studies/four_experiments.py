"""The study `four_experiments`: a step, a pulse and two sinusoids in open loop, and what each says of stability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.core.rounding import plain, with_unit
from servobench.core.settings import PositiveFrequency, PositiveTime, PositiveVoltage
from servobench.lab.graphs import over_time
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.boundedness import bibo
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.report.figures import Course, Curve, Panel
from servobench.report.illustrations import Illustration
from servobench.rig.experiment import Experiment
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.signals.base import Signal
from servobench.systems.signals.pulse import Pulse
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.step import Step

_NAMES = ("step", "pulse", "sinusoid", "sinusoid with an offset")


@dataclass(frozen=True, kw_only=True, eq=False)
class _Run:
    """One of the experiments: its name, position and speed, and how the position drifts [rad/s]."""

    name: str
    position: Dataset
    speed: Dataset
    drift: float


@STUDIES.member("four_experiments")
class FourExperiments(StudySettings):
    """The four bounded inputs of the stability exercise, one after the other: which drive the position off, and which don't."""

    level: PositiveVoltage = 1.0
    """Height of step, pulse and offset, and amplitude of the sinusoids [V]."""
    duration: PositiveTime = 2.5
    """Length of each run; a sinusoid's is made one of whole periods [s]."""
    width: PositiveTime = 0.1
    """Length of the pulse [s]."""
    frequency: PositiveFrequency = 0.4
    """Frequency of the sinusoids [Hz]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table of the four runs, their courses, and what each record says."""
        runs = [self._run(stand, name, signal) for name, signal in zip(_NAMES, self._signals(), strict=True)]
        columns = (
            Column(name="input", heading="input", values=_NAMES),
            Column(name="largest", heading="largest input", unit="V", values=tuple(_largest(r.position.u) for r in runs)),
            Column(name="speed", heading="largest speed", unit="rad/s", values=tuple(_largest(r.speed.y) for r in runs)),
            Column(name="end", heading="position at the end", unit="rad", values=tuple(float(r.position.y[-1]) for r in runs)),
            Column(
                name="drift", heading="position goes off by", unit="rad/s", values=tuple(r.drift for r in runs), digits=3
            ),
            Column(name="position", heading="position in this run", values=tuple(map(self._summary, runs))),
        )  # fmt: skip
        note = (
            "The drift is the slope over the last quarter of step and pulse, and from period to period of a "
            "sinusoid. A bounded position for one input proves nothing; a single input that makes it unbounded "
            "proves instability."
        )
        return StudyResult(
            tables=(Table(title="Four bounded inputs", columns=columns, note=note),),
            figures=(self._figure(runs),),
            sentences=tuple(
                f"{run.name.capitalize()}: {bibo(run.position).sentences[-2]}" for run in runs[:2]
            ),
        )

    def _signals(self) -> tuple[Signal, ...]:
        return (
            Step(final=self.level),
            Pulse(level=self.level, width=self.width),
            Sine(amplitude=self.level, frequency=self.frequency),
            Sine(amplitude=self.level, offset=self.level, frequency=self.frequency),
        )

    def _run(self, stand: Stand, name: str, signal: Signal) -> _Run:
        period = 1 / self.frequency
        # A sinusoid needs a period to settle and one to be read.
        duration = (
            self.duration if not isinstance(signal, Sine) else max(2, round(self.duration / period)) * period
        )
        experiment = Experiment(
            name=name,
            signal=signal,
            controller=OpenLoop(),
            duration=duration + 2 * stand.experiment.sample_time,
            sample_time=stand.experiment.sample_time,
            device=stand.experiment.device,
            limits=stand.experiment.limits,
            seed=stand.experiment.seed,
        )
        recording = stand.run(experiment)
        position = measure(recording)
        return _Run(
            name=name,
            position=position,
            speed=measure(recording, "derivative | lowpass 50 rad/s"),
            drift=_drift(position, period if isinstance(signal, Sine) else None, duration),
        )

    def _summary(self, run: _Run) -> str:
        # Two counts over the time that the slope is read over are no drift.
        if abs(run.drift) * 0.25 * run.position.duration <= 2 * (run.position.quantum or 0.0):
            return "stays bounded"
        return "goes off"

    def _figure(self, runs: list[_Run]) -> Illustration:
        courses = tuple(_course(run) for run in runs)
        caption = "; ".join(
            f"{run.name}: speed up to {with_unit(_largest(run.speed.y), 'rad/s', 3)}, position at the end "
            f"{with_unit(float(run.position.y[-1]), 'rad', 3)}"
            for run in runs
        )
        return over_time(
            name="four-experiments",
            title="Four bounded inputs: voltage, speed and position",
            caption="The speed is behind the filter 50/(s + 50). Note the scales of the position.",
            description=f"{caption}. The frequency of the sinusoids is {plain(self.frequency)} Hz.",
            courses=courses,
        )


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max())


def _drift(data: Dataset, period: float | None, duration: float) -> float:
    """The slope of the position: over the last quarter, or over the last whole period of a sinusoid [rad/s]."""
    t, y = data.t_output, data.y
    if period is None:
        last = t >= duration - 0.25 * duration
        return float(np.polyfit(t[last] - t[last][0], y[last] - y[last][0], 1)[0])
    before, end = np.interp([duration - period, duration], t, y)
    return float(end - before) / period


def _course(run: _Run) -> Course:
    t = run.position.t_output
    u = np.interp(t, run.position.t_input, run.position.u)
    return Course(
        title=run.name.capitalize(),
        panels=(
            Panel(title="Voltage", unit="V", curves=(Curve(t=t, y=u, look="input"),), height=70.0),
            Panel(title="Speed", unit="rad/s", curves=(Curve(t=t, y=run.speed.y, look="measured"),), height=90.0),
            Panel(title="Position", unit="rad", curves=(Curve(t=t, y=run.position.y, look="measured"),), height=90.0),
        ),
    )  # fmt: skip

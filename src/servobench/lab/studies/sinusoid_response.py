"""The study `sinusoid_response`: amplitude and phase of the speed under a sinusoid, and where the position goes meanwhile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.core.settings import PositiveFrequency, PositiveVoltage, Settings, Voltage
from servobench.lab.course import from_rest
from servobench.lab.graphs import over_time
from servobench.lab.motion import Motion, motion_of
from servobench.lab.required_facts import required_fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.recording import Recording
from servobench.report.illustrations import Illustration
from servobench.rig.experiment import Experiment
from servobench.systems.signals.sine import Sine


class Wave(Settings):
    """A sinusoid: amplitude, offset and frequency."""

    amplitude: PositiveVoltage = 1.0
    """Amplitude [V]."""
    offset: Voltage = 0.0
    """Mean voltage [V]."""
    frequency: PositiveFrequency = 0.4
    """Frequency [Hz]."""


@dataclass(frozen=True, kw_only=True)
class _Answer:
    """Amplitude [rad/s] and phase [deg] of the speed, drift of the angle in a period [rad], its span in the last one [rad]."""

    amplitude: float
    phase: float
    drift: float
    span: float


@STUDIES.member("sinusoid_response")
class SinusoidResponse(StudySettings):
    """Amplitude and phase of the speed at the frequency of the voltage, against the data sheet's motor without friction.

    K/√(1 + (ωτ)²), and -arctan(ωτ) - ωT/2, as a voltage that is held for a sample time T comes half of it late (Åström and
    Wittenmark 1997). From the angle of the last whole period: its drift is taken off, then the least-squares sinusoid is found;
    the speed's is ω times that.
    """

    periods: Annotated[int, Field(ge=3, le=50)] = 4
    """The length of each run in periods; the last two are evaluated."""
    waves: Annotated[tuple[Wave, ...], Field(min_length=1)] = (
        Wave(),
        Wave(amplitude=3.0),
        Wave(offset=2.0),
    )
    """The sinusoids."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the tables of sinusoids; raises `UsageError` for a period that isn't a whole number of samples."""
        runs = [stand.run(self._experiment(stand.experiment, wave)) for wave in self.waves]
        answers = [_answer(motion_of(run), wave) for run, wave in zip(runs, self.waves, strict=True)]
        linear = [_linear(stand, wave) for wave in self.waves]
        names = tuple(
            f"{plain(w.amplitude)} V about {plain(w.offset)} V, {plain(w.frequency)} Hz" for w in self.waves
        )
        tables = (_speeds(names, answers, linear), _angles(names, answers))
        return StudyResult(tables=tables, figures=(_figure(runs[0], runs[-1], self.waves),))

    def _experiment(self, experiment: Experiment, wave: Wave) -> Experiment:
        in_samples = 1 / (wave.frequency * experiment.sample_time)
        if abs(in_samples - round(in_samples)) > 1e-6:
            raise UsageError(
                f"a period of {1 / wave.frequency:g} s is {in_samples:g} samples of {experiment.sample_time:g} s; expected "
                "a whole number of them"
            )
        return experiment.model_copy(
            update={
                "signal": Sine(amplitude=wave.amplitude, offset=wave.offset, frequency=wave.frequency),
                "duration": self.periods / wave.frequency + experiment.sample_time,
            }
        )


def _speeds(names: tuple[str, ...], answers: list[_Answer], linear: list[tuple[float, float]]) -> Table:
    return Table(
        title="The speed's answer",
        columns=(
            Column(name="wave", heading="voltage", values=names),
            Column(
                name="amplitude",
                heading="amplitude",
                unit="rad/s",
                values=tuple(a.amplitude for a in answers),
            ),
            Column(
                name="linear",
                heading="without friction",
                unit="rad/s",
                values=tuple(a for a, _ in linear),
            ),
            Column(
                name="phase",
                heading="phase",
                unit="°",
                digits=3,
                values=tuple(a.phase for a in answers),
            ),
            Column(
                name="lag",
                heading="without friction",
                unit="°",
                digits=3,
                values=tuple(b for _, b in linear),
            ),
        ),
        note="Without friction: K·A/√(1 + (ωτ)²) and −arctan(ωτ) of the data sheet's motor, and half a sample of "
        "delay from the hold.",
    )


def _angles(names: tuple[str, ...], answers: list[_Answer]) -> Table:
    return Table(
        title="The angle meanwhile",
        columns=(
            Column(name="wave", heading="voltage", values=names),
            Column(
                name="drift",
                heading="drift in a period",
                unit="rad",
                digits=3,
                values=tuple(a.drift for a in answers),
            ),
            Column(
                name="span",
                heading="from end to end in a period",
                unit="rad",
                digits=3,
                values=tuple(a.span for a in answers),
            ),
        ),
    )


def _linear(stand: Stand, wave: Wave) -> tuple[float, float]:
    """Amplitude [rad/s] and phase [deg] of the speed of the data sheet's motor, without friction."""
    omega = 2 * math.pi * wave.frequency
    turn = omega * required_fact(stand, "sheet_time_constant")
    late = math.atan(turn) + 0.5 * omega * stand.experiment.sample_time
    return required_fact(stand, "sheet_gain") * wave.amplitude / math.hypot(1.0, turn), -math.degrees(late)


def _answer(motion: Motion, wave: Wave) -> _Answer:
    """The response in the last two whole periods; the mean over a whole period knows nothing of what repeats in it."""
    n = round(1 / (wave.frequency * float(motion.t[1] - motion.t[0])))
    last, before = motion.angle[-n:], motion.angle[-2 * n : -n]
    t, omega = motion.t[-n:], 2 * math.pi * wave.frequency
    drift = float(last.mean() - before.mean())
    swing = last - drift * wave.frequency * (t - t[0])
    # θ = Re(c e^(jωt)); the speed's is jω c, and the voltage is sin ωt = Re(-j e^(jωt)), so their ratio is -ω c.
    ratio = -omega * complex(2 * np.mean(swing * np.exp(-1j * omega * t)))
    phase = math.degrees(math.atan2(ratio.imag, ratio.real))
    return _Answer(amplitude=abs(ratio), phase=phase, drift=drift, span=float(last.max() - last.min()))


def _figure(first: Recording, last: Recording, waves: tuple[Wave, ...]) -> Illustration:
    courses = [
        from_rest(run, f"{plain(wave.amplitude)} V about {plain(wave.offset)} V")
        for run, wave in ((first, waves[0]), (last, waves[-1]))
    ]
    ends = [float(motion_of(run).angle[-1]) for run in (first, last)]
    return over_time(
        "waves",
        "A sinusoid about zero, and one about an offset",
        "Left (or above) the angle oscillates in place; with an offset it drifts away.",
        f"Both speeds follow the voltage. The first angle ends at {plain(ends[0], 3)} rad, the second one at "
        f"{plain(ends[1], 3)} rad.",
        courses,
    )

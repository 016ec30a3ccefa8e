"""The study `breakaway`: the voltage at which the shaft begins to move, with friction and with an amplifier's dead band."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.rounding import plain, with_unit
from servobench.core.settings import PositiveTime, PositiveVoltage, Settings, Torque, Voltage
from servobench.lab.graphs import curve, over_time, panel
from servobench.lab.motion import Motion, motion_of
from servobench.lab.required_facts import required_fact
from servobench.lab.runs import simulate_run
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.recording import Recording
from servobench.report.figures import Course, Curve, Look
from servobench.report.illustrations import Illustration
from servobench.rig.experiment import Experiment
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.ramp import Ramp

_MOVED = 2  # counts; less may be an edge of the disc that stands at a sensor
_STEADY = 2.0  # s; twenty time constants of a QUBE-Servo
_SHOWN = 1.0  # rad of the figure
_BISECTIONS = 60  # of a time: as fine as a float
_FASTEST = 0.05  # rad/s: what a creeping count or two in half a second amounts to isn't turning


class Case(Settings):
    """A simulated motor: its friction, and the dead band of its amplifier."""

    coulomb_torque: Annotated[Torque, Field(ge=0)] = 8e-4
    """Coulomb friction [N·m]."""
    dead_band: Annotated[Voltage, Field(ge=0)] = 0.0
    """Voltage that the amplifier loses [V]."""


@STUDIES.member("breakaway")
class Breakaway(StudySettings):
    """A slow ramp of the voltage, and where the shaft begins to move; then the speed at one voltage.

    At rest nothing moves until k (u - u_d)/R exceeds the Coulomb torque T_c, where u_d is the dead band of the amplifier, from
    which it follows by algebra that u = R T_c/k + u_d. As the ramp of r V/s goes on while the shaft gathers speed, that is seen
    late, by r t where K r (t²/2 - τ t + τ² (1 - e^(-t/τ))) is the angle of three counts; the note below the table says by how
    much.
    """

    to: PositiveVoltage = 1.2
    """Voltage at the end of the ramp [V]."""
    duration: PositiveTime = 24.0
    """Length of the ramp [s]."""
    sample_time: PositiveTime = 0.01
    """Sample time of all runs [s]."""
    voltage: Voltage = 0.5
    """Voltage at which the speed is examined [V]."""
    cases: Annotated[tuple[Case, ...], Field(min_length=1)] = (
        Case(coulomb_torque=0.0),
        Case(),
        Case(coulomb_torque=16e-4),
        Case(dead_band=0.35),
        Case(dead_band=0.65),
    )
    """The simulated motors."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the exercise's own motor first, then the simulated ones."""
        ramp, hold = self._ramp(stand.experiment), self._hold(stand.experiment)
        own = motion_of(stand.run(ramp))
        ramps = [own, *(motion_of(_of(case, ramp)) for case in self.cases)]
        holds = [motion_of(r) for r in (stand.run(hold), *(_of(case, hold) for case in self.cases))]
        resistance, k = (required_fact(stand, f"sheet_{name}") for name in ("resistance", "motor_constant"))
        friction = [math.nan, *(resistance * case.coulomb_torque / k for case in self.cases)]
        dead = [math.nan, *(case.dead_band for case in self.cases)]
        starts = [_start(each) for each in ramps]
        table = Table(
            title=f"A ramp from 0 to {plain(self.to)} V in {plain(self.duration)} s",
            columns=(
                Column(
                    name="motor", heading="motor", values=("this one", *("simulated" for _ in self.cases))
                ),
                Column(
                    name="friction", heading="Coulomb voltage", unit="V", values=tuple(friction), digits=3
                ),
                Column(name="dead", heading="dead band", unit="V", values=tuple(dead), digits=3),
                Column(
                    name="sum",
                    heading="sum",
                    unit="V",
                    values=tuple(a + b for a, b in zip(friction, dead, strict=True)),
                    digits=3,
                ),
                Column(name="start", heading="begins to move at", unit="V", values=tuple(starts), digits=3),
                Column(
                    name="speed",
                    heading=f"speed at {plain(self.voltage)} V",
                    unit="rad/s",
                    values=tuple(_speed(each) for each in holds),
                    digits=3,
                ),
            ),
            note=f"Seen {with_unit(self._lateness(stand), 'V', 2)} late: the ramp continues while the shaft turns "
            f"its first {_MOVED + 1} counts. The voltage alone doesn't show how much of the loss is friction.",
        )
        return StudyResult(tables=(table,), figures=(_figure(own, ramps[-1], self.cases[-1]),))

    def _lateness(self, stand: Stand) -> float:
        """The rise of the ramp [V] from the moment at which the data sheet's motor begins to slide until that is seen."""
        rate, tau = self.to / self.duration, required_fact(stand, "sheet_time_constant")
        angle = (_MOVED + 1) * 2 * math.pi / required_fact(stand, "counts_per_rev")
        turned = angle / (required_fact(stand, "sheet_gain") * rate * tau**2)
        low, high = (
            0.0,
            2.0 + math.sqrt(2 * turned),
        )  # as 1 - e^(-x) is not below 0
        for _ in range(_BISECTIONS):
            x = 0.5 * (low + high)
            low, high = (x, high) if 0.5 * x * x - x - math.expm1(-x) < turned else (low, x)
        return rate * tau * 0.5 * (low + high)

    def _ramp(self, experiment: Experiment) -> Experiment:
        signal = Ramp(initial=0.0, final=self.to, start=0.0, duration=self.duration)
        return experiment.model_copy(
            update={"signal": signal, "duration": self.duration, "sample_time": self.sample_time}
        )

    def _hold(self, experiment: Experiment) -> Experiment:
        return experiment.model_copy(
            update={
                "signal": Constant(value=self.voltage),
                "duration": _STEADY,
                "sample_time": self.sample_time,
            }
        )


def _of(case: Case, experiment: Experiment) -> Recording:
    return simulate_run(experiment, coulomb_torque=case.coulomb_torque, dead_band=case.dead_band)


def _start(motion: Motion) -> float:
    """The voltage that held when the shaft was first seen to have moved; NaN where it never did."""
    moved = np.abs(motion.angle) > (_MOVED + 0.5) * motion.count
    return float(motion.voltage[np.argmax(moved) - 1]) if moved.any() else math.nan


def _speed(motion: Motion) -> float:
    """The mean speed of the last half second; zero where it is a count or two."""
    speed = motion.between(motion.t[-1] - 0.5, motion.t[-1]).mean_speed
    return speed if abs(speed) > _FASTEST else 0.0


def _start_curve(motion: Motion, look: Look, label: str) -> Curve:
    """The angle until the shaft has turned so far that the beginning can't be seen any more."""
    far = np.abs(motion.angle) > _SHOWN
    end = int(np.argmax(far)) if far.any() else len(far)
    return curve(motion.t[:end], motion.angle[:end], look, label)


def _figure(own: Motion, other: Motion, case: Case) -> Illustration:
    where = f"behind a dead band of {plain(case.dead_band)} V"
    return over_time(
        "breakaway",
        "The ramp, and the angle that follows",
        f"Wide and grey: this motor. Thin and blue: a simulated one {where}. Each line ends where the shaft has turned by "
        f"{_SHOWN:g} rad.",
        f"This motor begins to move at {plain(_start(own), 2)} V, the one {where} at {plain(_start(other), 2)} V.",
        (
            Course(
                panels=(
                    panel("Voltage", "V", curve(own.t, own.voltage, "input"), height=90.0),
                    panel(
                        "Angle",
                        "rad",
                        _start_curve(own, "measured", "this motor"),
                        _start_curve(other, "model", f"dead band {plain(case.dead_band)} V"),
                    ),
                )
            ),
        ),
    )

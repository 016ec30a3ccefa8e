"""The study `pulse_response`: pulses of several widths, how far each turns the shaft, and what friction takes of it."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.errors import NotIdentifiable
from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, Settings, Voltage
from servobench.lab.course import from_rest
from servobench.lab.graphs import over_time
from servobench.lab.motion import Motion, motion_of
from servobench.lab.required_facts import required_fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.recording import Recording
from servobench.report.illustrations import Illustration
from servobench.rig.experiment import Experiment
from servobench.systems.signals.pulse import Pulse

_REST = 1.5  # s after a pulse: fifteen time constants of a QUBE-Servo


class Push(Settings):
    """A pulse: its voltage and its width."""

    voltage: Voltage = 1.0
    """Voltage [V]."""
    width: PositiveTime = 0.5
    """Width [s]."""


@STUDIES.member("pulse_response")
class PulseResponse(StudySettings):
    """Pulses from rest to rest: the angle that each leaves behind, against K times its area.

    From rest to rest θ = K (∫u dt - u_c t_m), which follows from the integral of J dω/dt = k i - b ω - T_c, where t_m is
    how long the shaft moved and u_c = R T_c/k the Coulomb voltage. Without friction a pulse would turn the shaft by K ∫u dt,
    whatever its shape; the data sheet's K is taken.
    """

    start: PositiveTime = 0.2
    """When each pulse begins [s]."""
    pulses: Annotated[tuple[Push, ...], Field(min_length=1)] = (
        Push(width=0.1),
        Push(width=0.25),
        Push(width=0.5),
        Push(voltage=2.0, width=0.25),
        Push(voltage=-1.0, width=0.5),
    )
    """The pulses."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table of pulses; raises `NotIdentifiable` where the shaft doesn't move or doesn't come to rest."""
        runs = [stand.run(self._experiment(stand.experiment, pulse)) for pulse in self.pulses]
        motions = [motion_of(run) for run in runs]
        table = self._table(motions, required_fact(stand, "sheet_gain"))
        return StudyResult(tables=(table,), figures=(_figure(runs[0], runs[-1], self.pulses),))

    def _table(self, motions: list[Motion], gain: float) -> Table:
        areas = [motion.area for motion in motions]
        angles = [float(motion.angle[-1]) for motion in motions]
        moving = [_motion_times(m, p, self.start) for m, p in zip(motions, self.pulses, strict=True)]
        friction = [
            (abs(area) - abs(angle) / gain) / (until - since)
            for area, angle, (since, until) in zip(areas, angles, moving, strict=True)
        ]
        ends = [self.start + pulse.width for pulse in self.pulses]
        return Table(
            title="Pulses from rest",
            columns=(
                Column(
                    name="voltage", heading="voltage", unit="V", values=tuple(p.voltage for p in self.pulses)
                ),
                Column(name="width", heading="width", unit="s", values=tuple(p.width for p in self.pulses)),
                Column(name="area", heading="area", unit="V·s", values=tuple(areas)),
                Column(
                    name="linear",
                    heading="K × area",
                    unit="rad",
                    digits=3,
                    values=tuple(gain * a for a in areas),
                ),
                Column(name="angle", heading="angle left", unit="rad", digits=3, values=tuple(angles)),
                Column(
                    name="rest",
                    heading="moves on for",
                    unit="s",
                    digits=2,
                    values=tuple(until - end for (_, until), end in zip(moving, ends, strict=True)),
                ),
                Column(
                    name="friction", heading="Coulomb voltage", unit="V", digits=2, values=tuple(friction)
                ),
            ),
            note="K × area is what would be left without friction. The Coulomb voltage is (area − angle/K) over "
            "the time that the shaft moved; it comes out a little high, because the data sheet's K is too "
            "high and the shaft creeps on after its last count.",
        )

    def _experiment(self, experiment: Experiment, pulse: Push) -> Experiment:
        return experiment.model_copy(
            update={
                "signal": Pulse(rest=0.0, level=pulse.voltage, start=self.start, width=pulse.width),
                "duration": self.start + pulse.width + _REST,
            }
        )


def _motion_times(motion: Motion, pulse: Push, start: float) -> tuple[float, float]:
    """From when to when the shaft moved [s]; raises `NotIdentifiable` where it never did or is moving still.

    The first count comes late, as the shaft has to turn by one before: it is taken to move from the pulse's begin on.
    """
    steps = np.flatnonzero(np.diff(motion.angle))
    if not len(steps):
        raise NotIdentifiable(
            f"a pulse of {plain(pulse.voltage)} V and {plain(pulse.width)} s doesn't move the shaft"
        )
    last = float(motion.t[steps[-1] + 1])
    if last > motion.t[-1] - 0.1:
        raise NotIdentifiable(f"the shaft still moves {_REST:g} s after a pulse of {plain(pulse.voltage)} V")
    return start, last


def _figure(first: Recording, last: Recording, pulses: tuple[Push, ...]) -> Illustration:
    courses = [
        from_rest(run, f"{plain(pulse.voltage)} V for {plain(pulse.width)} s")
        for run, pulse in ((first, pulses[0]), (last, pulses[-1]))
    ]
    angles = (float(motion_of(run).angle[-1]) for run in (first, last))
    return over_time(
        "pulses",
        "Two pulses",
        "The speed returns to zero; the angle stays where the pulse left it.",
        f"After the pulses the speed is zero, and the angle stays at {' and '.join(plain(a, 3) for a in angles)} rad.",
        courses,
    )

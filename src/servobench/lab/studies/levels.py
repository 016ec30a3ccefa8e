"""The study `levels`: what the shaft does at each level of the exercise's voltage."""

from __future__ import annotations

from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.lab.graphs import curve, over_time, panel
from servobench.lab.motion import Motion, motion_of
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.report.figures import Course
from servobench.report.illustrations import Illustration

_MOST = 40  # levels; a voltage that changes at every sample has none


@STUDIES.member("levels")
class Levels(StudySettings):
    """For each level of the voltage: the counts that it adds, the direction, and the mean speed in its second half.

    A positive voltage has to count up, or amplifier and encoder are wired against each other, and any feedback runs away.
    """

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table of levels; raises `UsageError` where the voltage is no sequence of levels."""
        motion = motion_of(stand.recording)
        levels = _levels(motion)
        return StudyResult(tables=(_table(levels),), figures=(_figure(motion, levels),))


def _table(levels: list[Motion]) -> Table:
    return Table(
        title="Level by level",
        columns=(
            Column(
                name="voltage",
                heading="voltage",
                unit="V",
                values=tuple(float(p.voltage[0]) for p in levels),
            ),
            Column(
                name="counts",
                heading="counts added",
                unit="counts",
                digits=6,
                values=tuple(round(float(p.angle[-1] - p.angle[0]) / p.count) for p in levels),
            ),
            Column(name="turned", heading="the counter", values=tuple(_way(p) for p in levels)),
            Column(
                name="speed",
                heading="mean speed in the second half",
                unit="rad/s",
                values=tuple(p.between(0.5 * (p.t[0] + p.t[-1]), p.t[-1]).mean_speed for p in levels),
            ),
        ),
        note="The motion at a level at rest is the run-out of the previous one.",
    )


def _figure(motion: Motion, levels: list[Motion]) -> Illustration:
    return over_time(
        "levels",
        "Voltage and angle",
        "The angle follows the sign of the voltage: every controller relies on that.",
        " ".join(f"At {plain(float(p.voltage[0]))} V the counter {_way(p)}." for p in levels),
        (
            Course(
                panels=(
                    panel("Voltage", "V", curve(motion.t, motion.voltage, "input"), height=90.0),
                    panel("Angle", "rad", curve(motion.t, motion.angle, "measured")),
                )
            ),
        ),
    )


def _levels(motion: Motion) -> list[Motion]:
    """The parts of a motion with one voltage each, up to the first sample of the next."""
    starts = motion.starts
    if len(starts) > _MOST:
        raise UsageError(
            f"the voltage changes {len(starts) - 1} times; the study `levels` expects {_MOST} levels at most, as a staircase has"
        )
    ends = (*starts[1:], len(motion.t) - 1)
    return [motion.between(motion.t[a], motion.t[b]) for a, b in zip(starts, ends, strict=True) if b > a]


def _way(part: Motion) -> str:
    """The direction in which the counter went: a count to and fro is none."""
    counts = (part.angle[-1] - part.angle[0]) / part.count
    return "goes up" if counts > 1 else "goes down" if counts < -1 else "stays"

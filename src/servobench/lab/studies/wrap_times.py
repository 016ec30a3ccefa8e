"""The study `wrap_times`: how far counters of several widths reach, and for how long at full speed."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime
from servobench.lab.graphs import curve, over_time, panel
from servobench.lab.motion import motion_of
from servobench.lab.required_facts import required_fact
from servobench.lab.runs import simulate_run
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.recording import Recording
from servobench.report.figures import Course
from servobench.report.illustrations import Illustration
from servobench.rig.experiment.limits import Limits
from servobench.systems.signals.constant import Constant


@STUDIES.member("wrap_times")
class WrapTimes(StudySettings):
    """Counters of n bits: 2ⁿ values, 2ⁿ/counts_per_rev turns from wrap to wrap, and the time for them at the fastest speed.

    The speed is that of the data sheet at the voltage limit, K u, without friction. The first jump comes after half of the way,
    as the counter starts at zero; from rest it comes a time constant later. A simulated motor shows the narrowest one.
    """

    bits: Annotated[tuple[Literal[16, 24, 32], ...], Field(min_length=1)] = (16, 24, 32)
    """Widths of the counters."""
    duration: PositiveTime = 2.5
    """Time that the simulated motor with the narrowest counter runs at its voltage limit [s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table of widths, and the jumps of a simulated counter of the smallest one."""
        voltage = required_fact(stand, "voltage_limit")
        speed = required_fact(stand, "sheet_gain") * voltage
        counts = required_fact(stand, "counts_per_rev")
        turns = [2.0**bits / counts for bits in self.bits]
        wrap = [2 * math.pi * each / speed for each in turns]
        widths = Table(
            title=f"At {plain(speed, 3)} rad/s, the data sheet's speed at {plain(voltage)} V",
            columns=(
                Column(name="bits", heading="width", values=self.bits, unit="bit"),
                Column(name="values", heading="values", values=tuple(2.0**b for b in self.bits), digits=10),
                Column(name="turns", heading="turns from wrap to wrap", values=tuple(turns), digits=7),
                Column(name="first", heading="first jump after", values=tuple(w / 2 for w in wrap), unit="s"),
                Column(name="wrap", heading="from jump to jump", values=tuple(wrap), unit="s"),
            ),
            note="The first jump comes after half of the range, as the counter starts at zero in its middle.",
        )
        recording = self._simulate(stand, voltage)
        jumps, figure = _jumps(recording, min(self.bits))
        return StudyResult(tables=(widths, jumps), figures=(figure,))

    def _simulate(self, stand: Stand, voltage: float) -> Recording:
        experiment = stand.experiment.model_copy(
            update={
                "signal": Constant(value=voltage),
                "duration": self.duration,
                "limits": Limits(voltage=voltage),
            }
        )
        return simulate_run(experiment, counter_bits=min(self.bits))


def _jumps(recording: Recording, bits: int) -> tuple[Table, Illustration]:
    """The counter's jumps in a run, and the picture of them."""
    motion = motion_of(recording)
    shown = recording["counts"].values
    steps = np.diff(shown)
    at = np.flatnonzero(np.abs(steps) > 2.0 ** (bits - 1)) + 1
    if not len(at):
        raise UsageError(
            f"in {motion.t[-1]:g} s a counter of {bits} bits doesn't jump; expected a longer `duration` or fewer `bits`"
        )
    table = Table(
        title=f"A simulated counter of {bits} bits, from rest",
        columns=(
            Column(name="jump", heading="jump", values=tuple(range(1, len(at) + 1))),
            Column(name="time", heading="at", values=tuple(float(t) for t in motion.t[at]), unit="s"),
            Column(name="before", heading="from", values=tuple(shown[at - 1]), unit="counts", digits=7),
            Column(name="after", heading="to", values=tuple(shown[at]), unit="counts", digits=7),
        ),
        note="They differ by the shaft's motion in one sample and one whole range of the counter.",
    )
    travel = motion.angle / motion.count
    figure = over_time(
        "wrap",
        f"A counter of {bits} bits at the end of its range",
        "Top: the counter's reading; bottom: the same unwrapped, the counts that the shaft has made.",
        f"The counter rises, and jumps from its largest to its smallest number {len(at)} times; unwrapped it rises "
        f"steadily to {plain(float(travel[-1]), 6)} counts.",
        (
            Course(
                panels=(
                    panel("Counter", "1000 counts", curve(motion.t, 1e-3 * shown, "measured")),
                    panel("Unwrapped", "1000 counts", curve(motion.t, 1e-3 * travel, "model")),
                )
            ),
        ),
    )
    return table, figure

"""The study `wrong_clock`: a program that counts another time in each step than really passes."""

from __future__ import annotations

import math
from dataclasses import replace

from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime
from servobench.identification.estimators.step_63 import time_to_63
from servobench.identification.estimators.steps import read_steps
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.lowpass import Lowpass
from servobench.recordings.measurement.measure import measure


@STUDIES.member("wrong_clock")
class WrongClock(StudySettings):
    """The exercise's experiment at every tick of a clock, by a program that takes each for the experiment's sample time."""

    clock: PositiveTime = 0.001
    """Time between two ticks of the clock [s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the time constant and the gain in true time and in the program's, and the filter that it really computes.

        Raises `UsageError` for a chain that makes no speed of a position.
        """
        believed = stand.experiment.sample_time
        chain = Chain.parse(stand.experiment.chain or "derivative")
        chain.yields("position")
        position = measure(stand.run(stand.experiment.model_copy(update={"sample_time": self.clock})))
        ratio = believed / self.clock
        rows = [_read(position, chain, 1.0), _read(position, chain, ratio)]
        filters = [stage.cutoff for stage in chain.stages if isinstance(stage, Lowpass)]
        cutoff = filters[0] if filters else math.nan
        motor = stand.facts["time_constant"].value
        columns = (
            Column(name="who", heading="the program counts", values=("the clock's time", "its own")),
            Column(name="step", heading="in a step", unit="ms", values=(1e3 * self.clock, 1e3 * believed)),
            Column(name="gain", heading="gain", unit="rad/(s·V)", values=tuple(row[0] for row in rows)),
            Column(name="reading", heading="63.2 % after", unit="s", values=tuple(row[1] for row in rows)),
            Column(name="cutoff", heading="its filter", unit="rad/s", values=(cutoff, cutoff * ratio)),
            Column(name="simulated", heading="its motor", unit="s", values=(motor, motor / ratio)),
        )  # fmt: skip
        table = Table(
            title=f"Steps of {plain(1e3 * believed)} ms on a clock of {plain(1e3 * self.clock)} ms",
            columns=columns,
            note=(
                f"What the program measures comes out wrong by {plain(ratio)}: times too long, speeds too small. "
                "What it computes, its filter or a simulated motor, runs too fast by the same factor; these two are "
                "given in true time."
            ),
        )
        return StudyResult(tables=(table,))


def _read(position: Dataset, chain: Chain, stretched: float) -> tuple[float, float]:
    """Gain and time constant as read off the speed, in times that are multiplied by a factor."""
    t = stretched * position.t_output
    data = replace(
        position,
        t_input=stretched * position.t_input,
        t_output=t,
        y=chain(position.y, t),
        kind="speed",
        output_unit="rad/s",
        quantum=None,
        applied=position.applied + chain,
    )
    gain, time_constant, _ = read_steps([data], time_to_63).mean
    return float(gain), float(time_constant)

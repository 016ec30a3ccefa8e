"""The study `stall`: a shaft that is held at several voltages, and the response of the stall monitor."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, PositiveVoltage, Settings
from servobench.lab.graphs import curve, over_time, panel
from servobench.lab.motion import speed_of
from servobench.lab.runs import simulate_run
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.recording import Recording
from servobench.report.figures import Course
from servobench.report.illustrations import Illustration
from servobench.rig.devices.faults.blocked_shaft import BlockedShaft
from servobench.rig.experiment.limits import StallLimits
from servobench.systems.signals.constant import Constant

_AFTER = 1.0  # s that a run goes on after the monitor should have cut it off


class StallCase(Settings):
    """A voltage under which the shaft is held, and the monitor that watches."""

    voltage: PositiveVoltage = 6.0
    """Voltage [V]."""
    monitor: StallLimits = StallLimits()
    """Thresholds and times."""


@STUDIES.member("stall")
class Stall(StudySettings):
    """A simulated shaft that is taken hold of while it turns, under each voltage: when the monitor cuts it off.

    It is stalled while |u| is above the control threshold and |ω| below the motion threshold; after the duration without a
    break it is cut off. Meanwhile the winding carries u/R and turns u²/R into heat, as no speed takes any of the voltage off.
    """

    block: PositiveTime = 1.0
    """When the shaft is taken hold of [s]."""
    cases: Annotated[tuple[StallCase, ...], Field(min_length=1)] = (
        StallCase(voltage=4.0),
        StallCase(voltage=6.0),
        StallCase(voltage=10.0),
        StallCase(voltage=4.0, monitor=StallLimits(voltage=1.0, motion=0.3, duration=10.0)),
    )
    """The voltages, each with its monitor."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return what became of each run."""
        runs = [self._run(stand, case) for case in self.cases]
        figures = tuple(_figure(run) for run in runs if _is_cut_short(run))[:1]
        return StudyResult(
            tables=(self._table(runs),), figures=figures, sentences=_sentences(self.cases, runs)
        )

    def _table(self, runs: list[Recording]) -> Table:
        held = [self._mean_stall_current(run) for run in runs]
        cut = [float(run["applied"].t[-1]) - self.block if _is_cut_short(run) else math.nan for run in runs]  # type: ignore[index]
        return Table(
            title=f"A simulated shaft that is held after {plain(self.block)} s",
            columns=(
                Column(
                    name="voltage", heading="voltage", unit="V", values=tuple(c.voltage for c in self.cases)
                ),
                Column(
                    name="threshold",
                    heading="watched above",
                    unit="V",
                    values=tuple(c.monitor.voltage for c in self.cases),
                ),
                Column(
                    name="duration",
                    heading="may last",
                    unit="s",
                    values=tuple(c.monitor.duration for c in self.cases),
                ),
                Column(name="cut", heading="cut off after", unit="s", values=tuple(cut)),
                Column(name="current", heading="current while held", unit="A", values=tuple(held), digits=3),
                Column(
                    name="heat",
                    heading="heat in the winding",
                    unit="W",
                    values=tuple(i * c.voltage for i, c in zip(held, self.cases, strict=True)),
                    digits=3,
                ),
            ),
            note="Without a time the run continued to its end: below the threshold a stall isn't detected.",
        )

    def _run(self, stand: Stand, case: StallCase) -> Recording:
        experiment = stand.experiment.model_copy(
            update={
                "signal": Constant(value=case.voltage),
                "duration": self.block + case.monitor.duration + _AFTER,
                "limits": stand.experiment.limits.model_copy(update={"stall": case.monitor}),
            }
        )
        return simulate_run(experiment, (BlockedShaft.model_validate({"from": self.block}),))

    def _mean_stall_current(self, run: Recording) -> float:
        """The mean current while the shaft was held [A]."""
        current = run["current"]
        if current.t is None:
            return math.nan
        return float(np.mean(current.values[current.t > self.block + 0.1]))


def _is_cut_short(run: Recording) -> bool:
    return run.stopped.reason == "fault"


def _sentences(cases: tuple[StallCase, ...], runs: list[Recording]) -> tuple[str, ...]:
    """The monitor's sentences, run by run."""
    return tuple(
        f"Held under {plain(case.voltage)} V: {run.stopped.sentence}."
        for case, run in zip(cases, runs, strict=True)
    )


def _figure(run: Recording) -> Illustration:
    t, speed = speed_of(run, "derivative | lowpass 50 rad/s")
    applied, current = run["applied"], run["current"]
    at = applied.t if applied.t is not None else t
    return over_time(
        "stall",
        "A shaft that is held, then cut off",
        "The current rises to that of a motor at rest, as there is no back-emf, until the run is ended.",
        f"The speed falls to zero; the current goes to {plain(float(current.values[-1]), 2)} A and stays there until the run "
        f"ends after {plain(float(t[-1]), 3)} s.",
        (
            Course(
                panels=(
                    panel("Voltage", "V", curve(at, applied.values, "input"), height=90.0),
                    panel("Speed", "rad/s", curve(t, speed, "measured")),
                    panel(
                        "Current",
                        "A",
                        curve(current.t if current.t is not None else t, current.values, "model"),
                    ),
                )
            ),
        ),
    )

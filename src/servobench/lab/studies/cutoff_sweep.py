"""The study `cutoff_sweep`: noise, lag and the reading of a time constant behind low-pass filters of several cut-offs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.rounding import plain, with_unit
from servobench.core.settings import Speed, Voltage
from servobench.identification.estimators.step_63 import time_to_63
from servobench.identification.estimators.steps import Readings, read_steps
from servobench.lab.expression import Fact
from servobench.lab.filter_reading import BestCutoff, Rise, best_cutoff, filtered_derivative
from servobench.lab.graphs import Graph, Line, Mark, figure_of
from servobench.lab.runs import quantum_of, steady_run, top_level
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.lowpass import Discretisation
from servobench.recordings.measurement.measure import measure
from servobench.report.illustrations import Illustration
from servobench.systems.filters.quantisation import noise
from servobench.systems.filters.response import lag

_BAND = 0.02  # of a step: what counts as settled
_MARKS: tuple[Mark, ...] = ("wide", "strong", "thin")


@STUDIES.member("cutoff_sweep")
class CutoffSweep(StudySettings):
    """The exercise's own recording, its counts differenced and filtered by one cut-off after the other."""

    cutoffs: Annotated[tuple[Annotated[Speed, Field(gt=0)], ...], Field(min_length=1)] = (
        10.0,
        20.0,
        50.0,
        100.0,
        150.0,
        200.0,
    )
    """Cut-offs of the filter [rad/s]."""
    discretisation: Discretisation = "euler"
    """The filter's computation: euler (as the paper's simulation loop does), zoh or tustin."""
    voltage: Voltage | None = None
    """Constant voltage at which the noise is examined; without it the highest of the exercise's signal [V]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table of the sweep, the filtered speeds, and the cut-off with the smallest error of a reading."""
        position = measure(stand.recording)
        chains = [filtered_derivative(cutoff, self.discretisation) for cutoff in self.cutoffs]
        speeds = [_through(position, chain) for chain in chains]
        readings = [read_steps([speed], time_to_63) for speed in speeds]
        true = stand.facts["time_constant"].value
        table = self._table(stand, chains, speeds, readings, true)
        best = best_cutoff(
            Rise(speed=_swing(readings[-1]), time_constant=true),
            stand.experiment.sample_time,
            quantum_of(position),
            discretisation=self.discretisation,
        )
        return StudyResult(
            tables=(self._filters(), table),
            figures=(_rises(self.cutoffs, speeds, readings[0]),),
            sentences=(_conclusion(best, true),),
            facts={
                "best": Fact(value=best.cutoff),
                "best_low": Fact(value=best.low),
                "best_high": Fact(value=best.high),
                "best_error": Fact(value=best.error.rms),
            },
        )

    def _filters(self) -> Table:
        """The filters: the paper's Table 1-4."""
        cutoffs = np.array(self.cutoffs)
        columns = (
            Column(name="cutoff", heading="cut-off", unit="rad/s", values=self.cutoffs),
            Column(name="hz", heading="cut-off", unit="Hz", values=_tuple(cutoffs / (2 * math.pi))),
            Column(name="time", heading="1/ω", unit="s", values=_tuple(1 / cutoffs)),
        )
        return Table(title="The filters", columns=columns)

    def _table(
        self,
        stand: Stand,
        chains: list[Chain],
        speeds: list[Dataset],
        readings: list[Readings],
        true: float,
    ) -> Table:
        T = stand.experiment.sample_time
        level = top_level(stand) if self.voltage is None else self.voltage
        steady = steady_run(stand, level, T)
        read = np.array([each.mean[1] for each in readings])
        exact = tuple(noise(chain, steady.speed, T, steady.quantum) for chain in chains)
        settled = tuple(_settling_time(s, r) for s, r in zip(speeds, readings, strict=True))
        columns = (
            Column(name="filter", heading="cut-off", unit="rad/s", values=self.cutoffs),
            Column(
                name="lag", heading="lag", unit="ms", values=tuple(1e3 * lag(chain, T) for chain in chains)
            ),
            Column(
                name="noise", heading="noise", unit="rad/s", values=tuple(map(steady.noise, chains)), digits=3
            ),
            Column(name="exact", heading="formula", unit="rad/s", values=exact, digits=3),
            Column(name="reading", heading="63.2 % after", unit="s", values=_tuple(read)),
            Column(name="bias", heading="late by", unit="ms", values=_tuple(1e3 * (read - true)), digits=3),
            Column(name="settling", heading="settles in", unit="s", values=settled, digits=3),
        )
        return Table(
            title="The effect of the cut-off",
            columns=columns,
            note=(
                f"Noise is the rms at {plain(steady.speed, 4)} rad/s, from a run at {plain(level)} V, beside the exact formula. "
                f"The motor's own time constant is {plain(true, 4)} s, identified from the counts. The speed has settled when it "
                "stays within 2 % of the step."
            ),
        )


def _through(position: Dataset, chain: Chain) -> Dataset:
    """The speed that a chain makes of a position, as data of its own."""
    return replace(
        position,
        y=chain(position.y, position.t_output),
        kind="speed",
        output_unit="rad/s",
        quantum=None,
        applied=position.applied + chain,
    )


def _swing(readings: Readings) -> float:
    """The mean change of the speed in the steps that were read [rad/s]."""
    return float(
        np.mean(
            [abs(v[0] * (s.after - s.before)) for s, v in zip(readings.steps, readings.values, strict=True)]
        )
    )


def _settling_time(speed: Dataset, readings: Readings) -> float:
    """The settling time to 2 % of a step, as a mean over steps [s]."""
    times = []
    for step in readings.steps:
        first, last = (float(part.mean()) for part in step.steady(speed.t_output, speed.y))
        here = step.samples(speed.t_output)
        away = np.abs(speed.y[here] - last) > _BAND * abs(last - first)
        times.append(float(speed.t_output[here][np.flatnonzero(away)[-1]] - step.start))
    return float(np.mean(times))


def _rises(cutoffs: tuple[float, ...], speeds: list[Dataset], readings: Readings) -> Illustration:
    """The first step that was read, behind three of the filters."""
    step = next((s for s in readings.steps if s.after > s.before), readings.steps[0])
    shown = sorted({0, len(cutoffs) // 2, len(cutoffs) - 1}, reverse=True)
    lines = []
    for mark, n in zip(_MARKS, shown, strict=False):
        here = step.samples(speeds[n].t_output)
        since = speeds[n].t_output[here] - step.start
        near = since <= 6 * float(readings.mean[1])
        lines.append(
            Line(
                x=since[near], y=speeds[n].y[here][near], label=f"{plain(cutoffs[n])} rad/s", mark=mark
            )
        )  # fmt: skip
    return figure_of(
        name="sweep",
        title="One step behind filters of several cut-offs",
        caption="A high cut-off lets the encoder's steps through; a low one makes the motor look slow.",
        description=(
            f"The speed after a step behind filters of {', '.join(plain(cutoffs[n]) for n in shown)} rad/s: the lower the "
            "cut-off, the smoother and the later."
        ),
        graphs=(Graph(title="Speed (rad/s)", over="time since the step (s)", lines=tuple(lines)),),
    )


def _conclusion(best: BestCutoff, true: float) -> str:
    off = best.error
    return (
        f"Read at 63.2 % without any correction, the time constant is least wrong behind a cut-off of {plain(best.cutoff, 2)} "
        f"rad/s (from {plain(best.low, 2)} to {plain(best.high, 2)} rad/s it is at most a tenth worse): off by "
        f"{with_unit(off.rms, 's', 2)}, from {with_unit(off.bias, 's', 2)} of lag and {with_unit(off.sd, 's', 2)} of scatter "
        f"that the encoder's steps make. That is {plain(100 * off.rms / true, 2)} % of the time constant."
    )


def _tuple(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)

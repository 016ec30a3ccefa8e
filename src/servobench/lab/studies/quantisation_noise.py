"""The study `quantisation_noise`: the noise of differenced counts, by formula and by run, over speeds and sample times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, Speed, Voltage
from servobench.lab.expression import Fact
from servobench.lab.graphs import Graph, Line, Mark, figure_of
from servobench.lab.runs import SteadyRun, steady_run
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.measurement.base import Chain
from servobench.report.illustrations import Illustration
from servobench.systems.filters.quantisation import count_fraction, derivative_noise

_MARKS: tuple[Mark, ...] = ("strong", "thin")
_ARCHES, _POINTS = 4, 256


@STUDIES.member("quantisation_noise")
class QuantisationNoise(StudySettings):
    """Runs at constant voltages and several sample times, and named speeds for the formula only."""

    voltages: Annotated[tuple[Voltage, ...], Field(min_length=1)] = (1.0, 2.0, 3.0)
    """Constant voltages to run at [V]."""
    sample_times: Annotated[tuple[PositiveTime, ...], Field(min_length=1)] = (0.002, 0.001)
    """Sample times [s]."""
    speeds: tuple[Speed, ...] = ()
    """Speeds for the formula alone [rad/s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return formula beside run for each voltage and sample time; facts: `worst`, the largest noise at the first time."""
        runs = [(v, T, steady_run(stand, v, T)) for v in self.voltages for T in self.sample_times]
        quantum = runs[0][2].quantum
        tables = [_table(runs)]
        if self.speeds:
            tables.append(self._table_of(quantum))
        return StudyResult(
            tables=tuple(tables),
            figures=(_figure(self.sample_times[:2], quantum, max(abs(run.speed) for _, _, run in runs)),),
            facts={"worst": Fact(value=0.5 * quantum / self.sample_times[0])},
        )

    def _table_of(self, quantum: float) -> Table:
        rows = [(speed, T) for speed in self.speeds for T in self.sample_times]
        columns = (
            Column(name="speed", heading="speed", unit="rad/s", values=tuple(speed for speed, _ in rows)),
            Column(name="time", heading="sample time", unit="ms", values=tuple(1e3 * T for _, T in rows)),
            Column(
                name="formula",
                heading="noise by formula",
                unit="rad/s",
                values=tuple(derivative_noise(speed, T, quantum) for speed, T in rows),
                digits=3,
            ),
        )
        return Table(title="The formula at speeds next to each other", columns=columns)


def _table(runs: Sequence[tuple[float, float, SteadyRun]]) -> Table:
    difference = Chain.parse("derivative")
    at = [(run.speed, T, run.quantum) for _, T, run in runs]
    columns = (
        Column(name="voltage", heading="voltage", unit="V", values=tuple(v for v, _, _ in runs)),
        Column(name="sample", heading="sample time", unit="ms", values=tuple(1e3 * T for _, T, _ in runs)),
        Column(name="turning", heading="speed", unit="rad/s", values=tuple(run.speed for _, _, run in runs), digits=6),
        Column(name="counts", heading="counts a sample", values=tuple(w * T / q for w, T, q in at), digits=5),
        Column(name="fraction", heading="f", values=tuple(count_fraction(*each) for each in at), digits=3),
        Column(name="exact", heading="formula", unit="rad/s", values=tuple(derivative_noise(*each) for each in at)),
        Column(name="noise", heading="noise", unit="rad/s", values=tuple(run.noise(difference) for _, _, run in runs)),
    )  # fmt: skip
    return Table(
        title="Noise of the differenced counts",
        columns=columns,
        note="Noise of the run, beside the formula (Δ/T) √(f (1 − f)), with f the fraction of ωT/Δ at the speed of the run.",
    )


def _figure(sample_times: Sequence[float], quantum: float, fastest: float) -> Illustration:
    """The arches of the formula, for one or two sample times, over the last few counts a sample below the fastest run."""
    arch = quantum / max(sample_times)
    last = math.ceil(fastest / arch)
    # So many points to an arch that its ends are among them, where the noise is zero.
    speeds = (
        arch / _POINTS * np.arange(max(last - _ARCHES, 0) * _POINTS, last * _POINTS + 1, dtype=np.float64)
    )
    lines = [
        Line(
            x=speeds,
            y=np.array([derivative_noise(w, T, quantum) for w in speeds]),
            label=f"{plain(1e3 * T)} ms",
            mark=mark,
        )
        for T, mark in zip(sample_times, _MARKS, strict=False)
    ]
    largest = quantum / min(sample_times) / 2
    return figure_of(
        name="quantisation",
        title="The noise depends on the speed",
        caption=(
            "At a whole number of counts per sample there is no noise; it is largest half a count away. A shorter "
            "sample time makes the arches higher and wider."
        ),
        description=(
            f"Noise of the difference over the speed: arches from zero to {plain(largest, 3)} rad/s, one for each count a "
            f"sample, {plain(2 * largest, 3)} rad/s wide."
        ),
        graphs=(Graph(title="Noise, rms (rad/s)", over="speed (rad/s)", lines=tuple(lines)),),
    )

"""The study `reading_errors`: how far a time constant is off that is read at 63.2 %, over cut-offs, sample times and speeds."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, Speed
from servobench.lab.filter_reading import (
    ReadingError,
    Rise,
    filtered_derivative,
    nearby,
    pool_errors,
    reading_error,
)
from servobench.lab.graphs import Graph, Line, Mark, figure_of
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.report.illustrations import Illustration
from servobench.systems.filters.quantisation import mean_noise

_PLACES = 16
_MARKS: tuple[Mark, ...] = ("strong", "thin", "dashed", "dotted")
_POINTS = 16


@STUDIES.member("reading_errors")
class ReadingErrors(StudySettings):
    """Bias and scatter of a reading behind `derivative | lowpass`, by calculation, for a motor like the one identified."""

    cutoffs: Annotated[tuple[Annotated[Speed, Field(gt=0)], ...], Field(min_length=1)] = (20.0, 50.0, 200.0)
    """Cut-offs of the filter, computed by Tustin [rad/s]."""
    sample_times: Annotated[tuple[PositiveTime, ...], Field(min_length=1)] = (0.002, 0.001)
    """Sample times [s]."""
    speeds: Annotated[tuple[Annotated[Speed, Field(gt=0)], ...], Field(min_length=1)] = (20.0, 47.6)
    """The change of speed in the step [rad/s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return a row for each speed, sample time and cut-off, and the error over the cut-off."""
        motor = stand.facts["time_constant"].value
        quantum = 2 * math.pi / stand.facts["counts_per_rev"].value
        cases = [(v, T, c) for v in self.speeds for T in self.sample_times for c in self.cutoffs]
        errors = [_error(v, motor, T, quantum, c) for v, T, c in cases]
        columns = (
            Column(name="speed", heading="step of", unit="rad/s", values=tuple(v for v, _, _ in cases)),
            Column(name="time", heading="sample time", unit="ms", values=tuple(1e3 * T for _, T, _ in cases)),
            Column(name="cutoff", heading="cut-off", unit="rad/s", values=tuple(c for _, _, c in cases)),
            Column(
                name="noise",
                heading="noise, all speeds",
                unit="rad/s",
                values=tuple(mean_noise(filtered_derivative(c), T, quantum) for _, T, c in cases),
                digits=3,
            ),
            Column(name="bias", heading="too late by", unit="ms", values=tuple(1e3 * e.bias for e in errors), digits=3),
            Column(name="scatter", heading="scatter", unit="ms", values=tuple(1e3 * e.sd for e in errors), digits=2),
            Column(name="error", heading="error, rms", unit="ms", values=tuple(1e3 * e.rms for e in errors), digits=3),
        )  # fmt: skip
        table = Table(
            title=f"A time constant of {plain(motor)} s, read at 63.2 %",
            columns=columns,
            note=(
                "Noise is the rms over all speeds, as the speed passes many of them while it rises. The steps start "
                "from rest, and the filter is discretised by Tustin; with forward Euler it passes more noise."
            ),
        )
        return StudyResult(tables=(table,), figures=(self._figure(motor, quantum),))

    def _figure(self, motor: float, quantum: float) -> Illustration:
        """The error over the cut-off, a line for each of the first speeds, at the first sample time."""
        sample_time = self.sample_times[0]
        cutoffs = np.geomspace(10.0, 1.8 / sample_time, _POINTS)
        lines = [
            Line(
                x=cutoffs,
                y=_errors(speed, motor, sample_time, quantum, cutoffs),
                label=f"{plain(speed)} rad/s",
                mark=mark,
            )
            for speed, mark in zip(self.speeds, _MARKS, strict=False)
        ]
        return figure_of(
            name="reading",
            title="Error of the reading over the cut-off",
            caption=(
                "On the left the filter's lag is read, on the right the encoder's steps. "
                f"Sampled every {plain(1e3 * sample_time)} ms."
            ),
            description="The rms error of a reading at 63.2 %: it falls with the cut-off, has a flat bottom, and rises again.",
            graphs=(Graph(title="Error, rms (ms)", over="cut-off (rad/s)", lines=tuple(lines), log="xy"),),)  # fmt: skip


def _errors(speed: float, motor: float, sample_time: float, quantum: float, cutoffs: Array) -> Array:
    """The rms errors (N,) [ms] for cut-offs (N,)."""
    return np.array([1e3 * _error(speed, motor, sample_time, quantum, float(c)).rms for c in cutoffs])


def _error(speed: float, motor: float, sample_time: float, quantum: float, cutoff: float) -> ReadingError:
    """The error of a reading, over speeds near to the given one."""
    chain = filtered_derivative(cutoff)
    rises = nearby(Rise(speed=speed, time_constant=motor), sample_time, quantum)
    return pool_errors([reading_error(chain, rise, sample_time, quantum, _PLACES) for rise in rises])

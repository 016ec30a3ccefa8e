"""The study `speed_estimators`: ways to make a speed of counts, side by side: noise, lag, and what is read off each at 63.2 %."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.rounding import plain
from servobench.core.settings import In, PositiveTime, Settings
from servobench.identification.estimators.step_63 import time_to_63
from servobench.identification.estimators.steps import Readings, read_steps
from servobench.lab.filter_reading import (
    ReadingError,
    Rise,
    edge_reading_error,
    nearby,
    pool_errors,
    reading_error,
)
from servobench.lab.runs import SteadyRun, quantum_of, steady_run, top_level
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.systems.filters.base import SpeedEstimate
from servobench.systems.filters.edges import edge_speed
from servobench.systems.filters.quantisation import noise
from servobench.systems.filters.response import lag
from servobench.systems.filters.tracking import AlphaBeta, MotorKalman

_PLACES = 16


def _makes_a_speed(text: str) -> str:
    if Chain.parse(text).yields("position") != "speed":
        raise UsageError(
            f"`{text}` doesn't turn a position into a speed; expected, for example, `derivative`"
        )
    return text


Acceleration = Annotated[float, In("rad/s²"), Field(gt=0)]
SpeedChain = Annotated[str, AfterValidator(_makes_a_speed)]


class KalmanCase(Settings):
    """A Kalman filter with a model of the motor: its parameters, and its trust in them."""

    time_constant: PositiveTime
    """Time constant in the filter's model [s]."""
    acceleration: Acceleration = 10.0
    """Standard deviation of the acceleration that the model doesn't know; a small one believes the model [rad/s²]."""


@dataclass(frozen=True, kw_only=True)
class _Row:
    name: str
    run_noise: Cell
    exact_noise: float
    lag: float
    reading: Cell
    error: ReadingError


@STUDIES.member("speed_estimators")
class SpeedEstimators(StudySettings):
    """Chains, α-β filters, Kalman filters and a tachometer, on the exercise's recording and by calculation."""

    chains: Annotated[tuple[SpeedChain, ...], Field(min_length=1)] = (
        "derivative",
        "derivative | lowpass 50 rad/s euler",
        "tachometer 40 ms",
        "least_squares 40 ms",
    )
    """Measurement chains that make a speed of a position."""
    alpha_beta: tuple[PositiveTime, ...] = (0.01,)
    """Time constants of critically damped α-β filters [s]."""
    constant_speed: tuple[Acceleration, ...] = (100.0,)
    """Random accelerations for Kalman filters of a shaft that keeps its speed [rad/s²]."""
    motor: tuple[KalmanCase, ...] = ()
    """Kalman filters of a first-order motor."""
    edges: tuple[Annotated[int, Field(ge=1)], ...] = (4,)
    """Counts whose time a tachometer measures."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table; a Kalman filter of the motor and a tachometer of times have cells that stay empty."""
        work = _Work.of(stand)
        rows = [
            *(work.linear(text, Chain.parse(text)) for text in self.chains),
            *(
                work.linear(
                    f"α-β, {plain(1e3 * time)} ms", AlphaBeta.critically_damped(time, work.sample_time)
                )
                for time in self.alpha_beta
            ),
            *(
                work.linear(
                    f"Kalman, constant speed, {plain(a)} rad/s²",
                    AlphaBeta.kalman(a, work.steady.quantum, work.sample_time),
                )
                for a in self.constant_speed
            ),
            *(work.kalman(case) for case in self.motor),
            *(work.edges(counts) for counts in self.edges),
        ]
        return StudyResult(tables=(_table(rows, work),))


def _table(rows: list[_Row], work: _Work) -> Table:
    columns = (
        Column(name="name", heading="speed by", values=tuple(row.name for row in rows)),
        Column(name="noise", heading="noise", unit="rad/s", values=tuple(row.run_noise for row in rows), digits=3),
        Column(name="exact", heading="formula", unit="rad/s", values=tuple(row.exact_noise for row in rows), digits=3),
        Column(name="lag", heading="lag", unit="ms", values=tuple(1e3 * row.lag for row in rows)),
        Column(name="reading", heading="63.2 % after", unit="s", values=tuple(row.reading for row in rows)),
        Column(name="bias", heading="late by", unit="ms", values=tuple(1e3 * row.error.bias for row in rows), digits=3),
        Column(name="scatter", heading="scatter", unit="ms", values=tuple(1e3 * row.error.sd for row in rows), digits=2),
    )  # fmt: skip
    return Table(
        title="Ways to compute a speed",
        columns=columns,
        note=(
            f"Noise of the run at {plain(work.steady.speed)} rad/s, beside the exact formula. The last two columns are computed, "
            f"over all places where the shaft may have stood, for a motor of {plain(work.rise.time_constant)} s that speeds up "
            f"by {plain(work.rise.speed, 3)} rad/s."
        ),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Work:
    """The data of all rows: the recording, a run at constant speed, and a motor like the one that was read."""

    position: Dataset
    steady: SteadyRun
    rise: Rise
    gain: float
    lost: float
    sample_time: float

    @classmethod
    def of(cls, stand: Stand) -> _Work:
        position = measure(stand.recording)
        sample_time = stand.experiment.sample_time
        rough = read_steps([_as_speed(position, Chain.parse("derivative | lowpass 50 rad/s"))], time_to_63)
        gain, _, lost = (float(value) for value in rough.mean)
        quantum_of(position)
        return cls(
            position=position,
            steady=steady_run(stand, top_level(stand), sample_time),
            rise=Rise(speed=_swing(rough), time_constant=stand.facts["time_constant"].value),
            gain=gain,
            lost=0.0 if math.isnan(lost) else lost,
            sample_time=sample_time,
        )

    def linear(self, name: str, estimate: SpeedEstimate) -> _Row:
        """A row of an estimate that knows of the positions alone."""
        return _Row(
            name=name,
            run_noise=self.steady.noise(estimate),
            exact_noise=noise(estimate, self.steady.speed, self.sample_time, self.steady.quantum),
            lag=lag(estimate, self.sample_time),
            reading=self._reading(estimate),
            error=pool_errors(
                [
                    reading_error(estimate, each, self.sample_time, self.steady.quantum, _PLACES)
                    for each in nearby(self.rise, self.sample_time, self.steady.quantum)
                ]
            ),
        )

    def kalman(self, case: KalmanCase) -> _Row:
        """A row of a filter that uses the voltage; its gain is that of the recording."""
        motor = MotorKalman(
            gain=self.gain,
            time_constant=case.time_constant,
            acceleration=case.acceleration,
            quantum=self.steady.quantum,
            sample_time=self.sample_time,
            voltage=_hold_voltage(self.position, self.lost),
        )
        silent = replace(motor, voltage=np.zeros_like)
        errors = [
            reading_error(
                replace(motor, gain=each.speed, voltage=_unit_step),
                each,
                self.sample_time,
                self.steady.quantum,
                _PLACES,
            )
            for each in nearby(self.rise, self.sample_time, self.steady.quantum)
        ]
        return _Row(
            name=f"Kalman, motor of {plain(case.time_constant)} s, {plain(case.acceleration)} rad/s²",
            run_noise="",
            exact_noise=noise(silent, self.steady.speed, self.sample_time, self.steady.quantum),
            lag=math.nan,
            reading=self._reading(motor),
            error=pool_errors(errors),
        )

    def edges(self, counts: int) -> _Row:
        """A row of a tachometer; a recording of counts has no times of edges, so it is computed alone."""
        quantum, speed = self.steady.quantum, abs(self.steady.speed)
        t = np.array([0.0, 4.0])
        at = np.arange(0.5, 4.0, self.sample_time)
        shown = edge_speed(t, speed * t, at, quantum, counts)
        return _Row(
            name=f"time of {counts} counts",
            run_noise="",
            exact_noise=float(np.sqrt(np.mean((shown - speed) ** 2))),
            lag=0.5 * (counts + 1) * quantum / speed,
            reading="",
            error=pool_errors(
                [
                    edge_reading_error(each, self.sample_time, quantum, counts, _PLACES)
                    for each in nearby(self.rise, self.sample_time, quantum)
                ]
            ),
        )

    def _reading(self, estimate: SpeedEstimate) -> Cell:
        try:
            return float(read_steps([_as_speed(self.position, estimate)], time_to_63).mean[1])
        except NotIdentifiable:
            return "can't be read"


def _as_speed(position: Dataset, estimate: SpeedEstimate) -> Dataset:
    """The data with the speed that an estimate makes of their position."""
    return replace(
        position,
        y=estimate(position.y, position.t_output),
        kind="speed",
        output_unit="rad/s",
        quantum=None,
    )


def _swing(readings: Readings) -> float:
    """The mean change of the speed in the steps that were read [rad/s]."""
    return float(
        np.mean(
            [abs(v[0] * (s.after - s.before)) for s, v in zip(readings.steps, readings.values, strict=True)]
        )
    )


def _hold_voltage(position: Dataset, lost: float) -> Callable[[Array], Array]:
    """The voltage of a recording less what friction takes of it, held from sample to sample."""

    def voltage(t: Array) -> Array:
        at = np.maximum(np.searchsorted(position.t_input, t + 1e-9, side="right") - 1, 0)
        return np.asarray(position.u[at] - lost)

    return voltage


def _unit_step(t: Array) -> Array:
    return np.where(t >= -1e-9, 1.0, 0.0)

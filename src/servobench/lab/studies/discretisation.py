"""The study `discretisation`: one low-pass filter, computed in three ways at several sample times."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple, get_args

import numpy as np
from pydantic import Field

from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, Speed
from servobench.lab.filter_reading import filtered_derivative
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.lowpass import Discretisation, Lowpass
from servobench.systems.filters.quantisation import noise
from servobench.systems.filters.response import frequency_response, lag

_DIVERGES = 2.0  # of ω T, by forward Euler


class _Row(NamedTuple):
    """One filter at one sample time; NaN where it diverges."""

    product: float
    pole: float
    lag: float
    noise: float
    amplitude: float
    behaves: Cell


@STUDIES.member("discretisation")
class DiscretisationTable(StudySettings):
    """Pole, lag, noise and amplitude of `derivative | lowpass` by forward Euler, ZOH and Tustin; nothing is run."""

    cutoff: Annotated[Speed, Field(gt=0)] = 50.0
    """Cut-off of the filter [rad/s]."""
    sample_times: Annotated[tuple[PositiveTime, ...], Field(min_length=1)] = (0.001, 0.002, 0.01, 0.05)
    """Sample times [s]."""
    speed: Annotated[Speed, Field(gt=0)] = 47.6
    """Speed at which the noise is computed [rad/s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table, a row for each sample time and method."""
        quantum = 2 * math.pi / stand.facts["counts_per_rev"].value
        cases = [(T, how) for T in self.sample_times for how in get_args(Discretisation)]
        rows = [self._row(how, T, quantum) for T, how in cases]
        columns = (
            Column(name="time", heading="sample time", unit="ms", values=tuple(1e3 * T for T, _ in cases)),
            Column(name="method", heading="method", values=tuple(how for _, how in cases)),
            Column(name="product", heading="ω T", values=tuple(row.product for row in rows)),
            Column(name="pole", heading="pole z", values=tuple(row.pole for row in rows)),
            Column(name="lag", heading="lag", unit="ms", values=tuple(1e3 * row.lag for row in rows)),
            Column(name="noise", heading="noise", unit="rad/s", values=tuple(row.noise for row in rows), digits=3),
            Column(name="amplitude", heading="left at ω", unit="%", values=tuple(100 * row.amplitude for row in rows)),
            Column(name="behaves", heading="a step", values=tuple(row.behaves for row in rows)),
        )  # fmt: skip
        table = Table(
            title=f"The filter {plain(self.cutoff)}/(s + {plain(self.cutoff)}) in discrete time",
            columns=columns,
            note=(
                "Lag and noise are those of difference and filter together, the noise of an encoder's counts at "
                f"{plain(self.speed)} rad/s."
            ),
        )
        return StudyResult(tables=(table,))

    def _row(self, how: Discretisation, sample_time: float, quantum: float) -> _Row:
        product = self.cutoff * sample_time
        pole = _pole(how, product)
        if how == "euler" and product >= _DIVERGES:
            return _Row(product, pole, math.nan, math.nan, math.nan, "diverges")
        chain = filtered_derivative(self.cutoff, how)
        alone = Chain((Lowpass(cutoff=self.cutoff, discretisation=how),))
        return _Row(
            product,
            pole,
            lag(chain, sample_time),
            noise(chain, self.speed, sample_time, quantum),
            float(np.abs(frequency_response(alone, np.array([self.cutoff]), sample_time))[0]),
            "settles" if pole >= 0 else "rings",
        )


def _pole(how: Discretisation, product: float) -> float:
    """The pole: the part of the output that is left in the next sample."""
    if how == "euler":
        return 1.0 - product
    return math.exp(-product) if how == "zoh" else (1.0 - 0.5 * product) / (1.0 + 0.5 * product)

"""The study `attenuation`: what a first-order low-pass filter leaves of sines of several frequencies."""

from __future__ import annotations

import math
from typing import Annotated, get_args

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.rounding import plain
from servobench.core.settings import Speed
from servobench.lab.graphs import Graph, Line, figure_of
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.lowpass import Discretisation, Lowpass
from servobench.report.illustrations import Illustration
from servobench.systems.filters.attenuation import attenuation
from servobench.systems.filters.response import frequency_response

_POINTS = 200


@STUDIES.member("attenuation")
class AttenuationTable(StudySettings):
    """Amplitude, power, decibels and phase behind ω_c/(s + ω_c), and behind the filter as it is computed at the sample time."""

    cutoff: Annotated[Speed, Field(gt=0)] = 50.0
    """Cut-off of the filter [rad/s]."""
    frequencies: Annotated[tuple[Annotated[Speed, Field(gt=0)], ...], Field(min_length=1)] = (
        5.0,
        25.0,
        50.0,
        100.0,
        500.0,
    )
    """Frequencies of the sines [rad/s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table, and the amplitudes over frequency."""
        omega = np.array(self.frequencies)
        left = [attenuation(self.cutoff, w) for w in self.frequencies]
        sample_time = stand.experiment.sample_time
        columns = (
            Column(name="frequency", heading="frequency", unit="rad/s", values=self.frequencies),
            Column(
                name="hz",
                heading="frequency",
                unit="Hz",
                values=tuple(float(w) for w in omega / (2 * math.pi)),
            ),
            Column(
                name="amplitude", heading="amplitude", unit="%", values=tuple(100 * a.amplitude for a in left)
            ),
            Column(name="power", heading="power", unit="%", values=tuple(100 * a.power for a in left)),
            Column(name="decibels", heading="attenuation", unit="dB", values=tuple(a.decibels for a in left)),
            Column(
                name="phase", heading="phase", unit="°", values=tuple(math.degrees(a.phase) for a in left)
            ),
        )
        table = Table(title=f"A sine after a filter of {plain(self.cutoff)} rad/s", columns=columns)
        computed = Table(
            title=f"The amplitude behind the filter when computed every {plain(1e3 * sample_time)} ms",
            columns=(
                Column(name="sine", heading="frequency", unit="rad/s", values=self.frequencies),
                *(
                    Column(
                        name=how,
                        heading=how,
                        unit="%",
                        values=tuple(100 * float(part) for part in self._compute(how, omega, sample_time)),
                    )
                    for how in get_args(Discretisation)
                ),
            ),
        )
        return StudyResult(tables=(table, computed), figures=(self._figure(sample_time),))

    def _compute(self, how: Discretisation, omega: Array, sample_time: float) -> Array:
        filtered = Chain((Lowpass(cutoff=self.cutoff, discretisation=how),))
        return np.asarray(np.abs(frequency_response(filtered, omega, sample_time)))

    def _figure(self, sample_time: float) -> Illustration:
        omega = np.geomspace(0.1 * self.cutoff, math.pi / sample_time, _POINTS)
        exact = np.array([attenuation(self.cutoff, w).amplitude for w in omega])
        lines = (
            Line(x=omega, y=exact, label="the filter", mark="wide"),
            Line(x=omega, y=self._compute("euler", omega, sample_time), label="Euler", mark="dashed"),
            Line(x=omega, y=self._compute("tustin", omega, sample_time), label="Tustin", mark="thin"),
        )
        return figure_of(
            name="attenuation",
            title="A sine after the filter",
            caption=(
                "The axis ends at half of the sample rate. There Tustin's filter passes nothing, Euler's too much."
            ),
            description=(
                f"Amplitude over frequency behind a filter of {plain(self.cutoff)} rad/s: 70.7 % at the cut-off, then falling "
                "to a tenth for each tenfold of the frequency."
            ),
            graphs=(Graph(title="Amplitude", over="frequency (rad/s)", lines=lines, log="xy", ends=(0.01, 1.3)),),)  # fmt: skip

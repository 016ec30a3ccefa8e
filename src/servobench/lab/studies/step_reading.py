"""The study `step_reading`: one step response, and the time constant that each way of reading it gives."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.errors import NotIdentifiable
from servobench.core.rounding import plain, with_unit
from servobench.core.settings import Speed
from servobench.lab.expression import Fact
from servobench.lab.graphs import curve, over_time, panel
from servobench.lab.motion import Motion, motion_of, speed_of
from servobench.lab.required_facts import required_fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.recording import Recording
from servobench.report.figures import Course
from servobench.report.illustrations import Illustration

_BISECTIONS = 60  # of a time: as fine as a float


@STUDIES.member("step_reading")
class StepReading(StudySettings):
    """The time constant of the exercise's step, read off in five ways, and identified.

    63.2 % of the speed behind the filter ω/(s + ω); 63.2 % of the plain differences; the slope of the logarithm behind it; the
    position's asymptote θ = K u (t - τ), which meets the height of the start τ after the step; 63.2 % with the filter taken
    out; and all samples of the position at once. `expected` is what each gives for a first-order motor of the identified τ: where
    a filter's lag T = 1/ω is in the reading, the time after which 1/((τs + 1)(Ts + 1)) has covered 1 - 1/e of a step, and half a
    sample time for the difference, which is the mean speed since the last sample. The fact `sheet` is the first of these for the
    data sheet's motor.
    """

    cutoff: Annotated[Speed, Field(gt=0)] = 50.0
    """Cut-off of the filter [rad/s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the readings; raises `NotIdentifiable` where the recording has no step to be read."""
        recording, tau = stand.recording, required_fact(stand, "time_constant")
        filtered = f"derivative | lowpass {self.cutoff:g} rad/s"
        late = 0.5 * stand.experiment.sample_time
        rows = (
            (
                "63.2 % of the speed behind the filter, of this one step",
                _read(recording, filtered, "step_63"),
                self._behind(tau) + late,
            ),
            ("63.2 % of the plain differences", _read(recording, "derivative", "step_63"), tau + late),
            ("slope of the logarithm, behind the filter", _read(recording, filtered, "log_linear"), math.nan),
            ("asymptote of the position", _asymptote(motion_of(recording)), tau),
            (
                "63.2 %, with the filter taken out",
                _read(recording, filtered, "step_63_corrected"),
                tau,
            ),
            ("identified from all samples", tau, tau),
        )
        table = Table(
            title="One step, read in several ways",
            columns=(
                Column(name="way", heading="how it is read", values=tuple(row[0] for row in rows)),
                Column(name="tau", heading="time constant", unit="s", values=tuple(row[1] for row in rows)),
                Column(
                    name="expected",
                    heading="by theory",
                    unit="s",
                    values=tuple(row[2] for row in rows),
                ),
                Column(
                    name="above",
                    heading="above the identified",
                    unit="%",
                    digits=2,
                    values=tuple(100 * (row[1] / tau - 1) for row in rows),
                ),
            ),
            note="By theory: for a first-order motor with the identified time constant. Differences have steps of "
            "one count per sample, which affects their reading. The slope of the logarithm depends on the "
            "part of the rise used for the line.",
        )
        sheet = self._behind(required_fact(stand, "sheet_time_constant")) + late
        return StudyResult(
            tables=(table,),
            figures=(self._figure(recording, rows[0][1]),),
            facts={"sheet": Fact(value=sheet)},
        )

    def _behind(self, tau: float) -> float:
        return behind_filter(tau, 1 / self.cutoff)

    def _figure(self, recording: Recording, time_constant: float) -> Illustration:
        motion = motion_of(recording)
        t, rough = speed_of(recording, "derivative")
        _, smooth = speed_of(recording, f"derivative | lowpass {self.cutoff:g} rad/s")
        return over_time(
            "step",
            "The step, and the speed with and without the filter",
            "Wide and grey: differences of the angle. Thin and blue: the same behind the filter, smoother and later.",
            f"The speed rises to {plain(float(smooth[-1]), 3)} rad/s; behind the filter it passes 63.2 % of it "
            f"{with_unit(time_constant, 's', 3)} after the step.",
            (
                Course(
                    panels=(
                        panel("Voltage", "V", curve(motion.t, motion.voltage, "input"), height=90.0),
                        panel(
                            "Speed",
                            "rad/s",
                            curve(t, rough, "measured", "differences"),
                            curve(t, smooth, "model", f"behind {self.cutoff:g}/(s + {self.cutoff:g})"),
                            height=190.0,
                        ),
                    )
                ),
            ),
        )


def behind_filter(tau: float, lag: float) -> float:
    """Return when the step response of 1/((τs + 1)(Ts + 1)) passes 1 - 1/e [s], for time constants τ and T [s].

    By algebra 1 - y(t) = (τ e^(-t/τ) - T e^(-t/T))/(τ - T), which falls from 1 to 0; for equal ones (1 + t/τ) e^(-t/τ).
    """
    low, high = 0.0, 3 * (tau + lag)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _remainder(middle, tau, lag) > math.exp(-1) else (low, middle)
    return 0.5 * (low + high)


def _remainder(t: float, tau: float, lag: float) -> float:
    if abs(tau - lag) < 1e-6 * tau:
        return (1 + t / tau) * math.exp(-t / tau)
    return (tau * math.exp(-t / tau) - lag * math.exp(-t / lag)) / (tau - lag)


def _read(recording: Recording, chain: str, estimator: str) -> float:
    from servobench.identification.identify import identify
    from servobench.recordings.measurement.measure import measure

    result = identify(measure(recording, chain), estimator=estimator)
    if result.fit is None:
        raise NotIdentifiable("; ".join(finding.sentence for finding in result.findings))
    return result.fit["time_constant"].value


def _asymptote(motion: Motion) -> float:
    """The time from the step at which the line through the last third of the angle meets the angle before the step [s]."""
    starts = motion.starts
    if len(starts) != 2:
        raise NotIdentifiable(
            f"the voltage changes {len(starts) - 1} times; the asymptote of the position is read off a single step"
        )
    at = float(motion.t[starts[1]])
    late = motion.between(motion.t[-1] - (motion.t[-1] - at) / 3, motion.t[-1])
    slope, height = np.polyfit(late.t - at, late.angle - motion.angle[starts[1]], 1)
    return float(-height / slope)

"""The study `step_size`: what a shorter sample time gains and costs: resolution of time, of speed, of the estimate."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from servobench.core.errors import NotIdentifiable
from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime
from servobench.identification.identify import identify
from servobench.lab.expression import Fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.measure import measure
from servobench.systems.filters.quantisation import mean_noise


@STUDIES.member("step_size")
class StepSize(StudySettings):
    """The exercise's experiment at several sample times, identified from the counts of each."""

    sample_times: Annotated[tuple[PositiveTime, ...], Field(min_length=1)] = (0.02, 0.01, 0.005, 0.002, 0.001)
    """Sample times [s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table, a row for each sample time; raises `NotIdentifiable` where a run can't be identified."""
        quantum = 2 * math.pi / stand.facts["counts_per_rev"].value
        known = [_identify(stand, T) for T in self.sample_times]
        difference = Chain.parse("derivative")
        columns = (
            Column(name="time", heading="sample time", unit="ms", values=tuple(1e3 * T for T in self.sample_times)),
            Column(
                name="samples",
                heading="samples in τ",
                values=tuple(tau.value / T for tau, T in zip(known, self.sample_times, strict=True)),
                digits=3,
            ),
            Column(name="speed", heading="speed step", unit="rad/s", values=tuple(quantum / T for T in self.sample_times)),
            Column(
                name="noise",
                heading="noise",
                unit="rad/s",
                values=tuple(mean_noise(difference, T, quantum) for T in self.sample_times),
                digits=3,
            ),
            Column(name="tau", heading="τ from counts", unit="s", values=tuple(tau.value for tau in known), digits=5),
            Column(name="half", heading="± of τ", unit="ms", values=tuple(1e3 * tau.half for tau in known), digits=2),
        )  # fmt: skip
        table = Table(
            title="The effect of the sample time",
            columns=columns,
            note=(
                f"One count more or less in a sample is a step of the speed of Δ/T, with Δ = {plain(quantum)} rad. Noise is the "
                "rms over all speeds. The time constant τ is identified from the counts themselves, not from the speed, with its "
                "95 % interval."
            ),
        )
        return StudyResult(tables=(table,))


def _identify(stand: Stand, sample_time: float) -> Fact:
    if sample_time == stand.experiment.sample_time:
        return stand.facts["time_constant"]
    recording = stand.run(stand.experiment.model_copy(update={"sample_time": sample_time}))
    result = identify(measure(recording))
    if result.fit is None:
        reasons = "; ".join(finding.sentence for finding in result.findings)
        raise NotIdentifiable(f"the run with {sample_time:g} s determines no time constant: {reasons}")
    tau = result.fit["time_constant"]
    return Fact(value=tau.value, half=0.5 * (tau.interval[1] - tau.interval[0]))

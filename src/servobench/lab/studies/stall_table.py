"""The study `stall_table`: the current of a shaft that is held, voltage by voltage, and the resistance that follows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, Voltage
from servobench.lab.expression import Fact
from servobench.lab.motion import at_levels
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.lab.truth import truth_if_known
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.systems.signals.staircase import Staircase

if TYPE_CHECKING:
    from servobench.report.illustrations import Illustration
    from servobench.rig.experiment import Experiment

TEN: tuple[float, ...] = (-5.0, -4.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.0, 5.0)


@STUDIES.member("stall_table")
class StallTable(StudySettings):
    """The current at each voltage while something holds the shaft: R = V/i by definition, as there is no back-emf.

    `resistance` is the slope of a line through all of them, which an offset of the current sensor doesn't change; `mean` the mean
    of V/i, in which the small voltages count as much as the large ones.
    """

    voltages: Annotated[tuple[Voltage, ...], Field(min_length=2)] = TEN
    """Voltages, none of them zero [V]."""
    dwell: PositiveTime = 1.0
    """Time at each voltage; the current is the mean of its second half [s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table, the line and the resistance; raises `UsageError` for 0 V."""
        if 0.0 in self.voltages:
            raise UsageError(
                f"the voltages {self.voltages} V include 0 V, which drives no current; leave it out"
            )
        recording = stand.run(block_shaft(stand.experiment, self.voltages, self.dwell))
        truth, levels = truth_if_known(recording), at_levels(recording, self.dwell)
        v = np.array(self.voltages)
        i = np.array([level.current for level in levels])
        slope, sd = _resistance(v, i)
        each = v / i
        values = {
            "resistance": slope,
            "resistance_sd": sd,
            "mean": float(each.mean()),
            **({"true_resistance": truth.resistance} if truth else {}),
        }
        return StudyResult(
            tables=(_table(v, i, each, slope, sd),),
            figures=(_figure(v, i, slope),),
            facts={name: Fact(value=value) for name, value in values.items()},
        )


def block_shaft(experiment: Experiment, voltages: Sequence[float], dwell: float) -> Experiment:
    """Return the experiment with those voltages [V], each held for a time [s], on a motor whose shaft is held."""
    device = DeviceChoice(
        name=experiment.device.name,
        settings=experiment.device.settings,
        faults=({"name": "blocked_shaft"},),
    )
    signal = Staircase(levels=tuple(voltages), dwell=dwell)
    return experiment.model_copy(
        update={"signal": signal, "duration": dwell * len(voltages), "device": device}
    )


def _resistance(v: Array, i: Array) -> tuple[float, float]:
    """The slope of V over i by least squares of i on V, as the noise is the current's, and its standard deviation [Ω]."""
    x = np.column_stack([v, np.ones(len(v))])
    coefficients = np.linalg.lstsq(x, i, rcond=None)[0]
    left = i - x @ coefficients
    sd = np.sqrt(float(left @ left) / max(len(v) - 2, 1) * np.linalg.inv(x.T @ x)[0, 0])
    return float(1 / coefficients[0]), float(sd / coefficients[0] ** 2)


def _table(v: Array, i: Array, each: Array, slope: float, sd: float) -> Table:
    return Table(
        title="The shaft held by hand",
        columns=(
            Column(name="voltage", heading="v", unit="V", values=tuple(map(float, v))),
            Column(name="current", heading="i", unit="A", values=tuple(map(float, i))),
            Column(name="ohm", heading="v/i", unit="Ω", values=tuple(map(float, each))),
        ),
        note=f"Mean of v/i: {plain(float(each.mean()))} Ω. Slope of the line: {plain(slope)} Ω ± {plain(sd, 2)} Ω (sd).",
    )


def _figure(v: Array, i: Array, slope: float) -> Illustration:
    from servobench.lab.graphs import Graph, Line, figure_of

    offset = float(np.mean(i - v / slope))
    lines = (
        Line(x=v, y=v / slope + offset, mark="strong", label="line"),
        Line(x=v, y=i, mark="points", label="measured"),
    )
    return figure_of(
        "stall",
        "The current of the stalled motor",
        "One over the slope is the resistance.",
        f"The current goes from {plain(float(i[0]))} A at {plain(float(v[0]))} V to {plain(float(i[-1]))} A at "
        f"{plain(float(v[-1]))} V.",
        (Graph(title="Current (A)", over="voltage (V)", lines=lines),),
    )

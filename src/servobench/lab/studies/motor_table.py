"""The study `motor_table`: the motor's parameters by identification, with and without a stalled run, each with its interval."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from servobench.core.errors import NotIdentifiable
from servobench.core.settings import PositiveTime, Voltage
from servobench.lab.expression import Fact
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table
from servobench.lab.studies.stall_table import TEN, block_shaft
from servobench.lab.truth import Truth, truth_of

if TYPE_CHECKING:
    from servobench.core.estimate import Estimate

_NAMES: Mapping[str, str] = {
    "resistance": "R (Ω)",
    "motor_constant": "k (V·s/rad)",
    "inertia": "J (kg·m²)",
    "viscous_friction": "b (N·m·s/rad)",
    "coulomb_torque": "Coulomb torque (N·m)",
}


@STUDIES.member("motor_table")
class MotorTable(StudySettings):
    """R, k, J, b and the Coulomb torque out of the exercise's recording and its current, and once more with a stalled run.

    As the verb `motor_parameters` finds them: from gain, time constant and Coulomb voltage, and from the winding's equation.
    A parameter that the data don't determine has no value.
    """

    voltages: Annotated[tuple[Voltage, ...], Field(min_length=2)] = TEN
    """Voltages of the stalled run [V]."""
    dwell: PositiveTime = 1.0
    """Time at each of them [s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table; raises `NotIdentifiable` for a recording that supports no model or a motor that is not simulated."""
        from servobench.identification.identify import identify
        from servobench.identification.motor_parameters import motor_parameters
        from servobench.recordings.measurement.measure import measure

        truth = truth_of(stand.recording)
        result = identify(measure(stand.recording))
        if result.fit is None:
            raise NotIdentifiable(
                "the recording supports no model: " + " ".join(f.sentence for f in result.findings)
            )
        stalled = measure(stand.run(block_shaft(stand.experiment, self.voltages, self.dwell)))
        both = motor_parameters(result.fit, stalled=(stalled,)).estimates
        alone = motor_parameters(result.fit).estimates
        facts = {name: _fact(estimate) for name, estimate in both.items()}
        return StudyResult(tables=(_table(alone, both, truth),), facts=facts)


def _fact(estimate: Estimate) -> Fact:
    low, high = estimate.interval
    return Fact(value=estimate.value, half=0.5 * (high - low))


def _table(alone: Mapping[str, Estimate], both: Mapping[str, Estimate], truth: Truth) -> Table:
    def values(estimates: Mapping[str, Estimate]) -> tuple[Cell, ...]:
        return tuple(estimates[name].value if name in estimates else math.nan for name in _NAMES)

    def sds(estimates: Mapping[str, Estimate]) -> tuple[Cell, ...]:
        return tuple(
            100 * estimates[n].sd / estimates[n].value if n in estimates else math.nan for n in _NAMES
        )

    return Table(
        title="The same by identification",
        columns=(
            Column(name="parameter", heading="parameter", values=tuple(_NAMES.values())),
            Column(name="alone", heading="free shaft", values=values(alone)),
            Column(name="alone_sd", heading="sd", unit="%", digits=2, values=sds(alone)),
            Column(name="both", heading="and stalled", values=values(both)),
            Column(name="both_sd", heading="sd", unit="%", digits=2, values=sds(both)),
            Column(
                name="true", heading="the motor's own", values=tuple(getattr(truth, name) for name in _NAMES)
            ),
        ),
        note="By the recording of the free shaft with its current, and together with that of the stalled one.",
    )

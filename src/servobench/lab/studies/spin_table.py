"""The study `spin_table`: speed and current of the free shaft, voltage by voltage, and the motor's parameters that follow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import Field, model_validator

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, Voltage
from servobench.lab.expression import Expression, Fact
from servobench.lab.motion import Level, at_levels
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table
from servobench.lab.studies.stall_table import TEN
from servobench.lab.truth import Truth, truth_if_known
from servobench.systems.signals.staircase import Staircase

if TYPE_CHECKING:
    from servobench.report.illustrations import Illustration
    from servobench.rig.motor.parameters import MotorParameters


@STUDIES.member("spin_table")
class SpinTable(StudySettings):
    """Speed and current at each voltage while the shaft turns freely: k = (V - R i)/ω, with the resistance that is known by then.

    The torque k i is all friction's at a steady speed, so that a line of it over the speed tells viscous friction and Coulomb
    torque, k i = b ω + T_c sgn(ω). With the inertia of the data sheet `sheet` it follows from them by algebra that
    K = k/(R b + k²) and τ = R J/(R b + k²).
    """

    resistance: str = "stall_resistance"
    """The resistance [Ω]: an expression over facts, such as that of the stalled shaft."""
    sheet: str = "qube_servo_2"
    """The data sheet that the inertia comes from, and what else there is to compare with."""
    voltages: Annotated[tuple[Voltage, ...], Field(min_length=4)] = TEN
    """Voltages, all large enough to turn the shaft, in both directions [V]."""
    dwell: PositiveTime = 2.0
    """Time at each voltage; speed and current are the means of its second half [s]."""

    @model_validator(mode="after")
    def _can_be_computed(self) -> SpinTable:
        Expression(self.resistance)
        return self

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table, the parameters and the line of friction.

        The motor's own parameters stand beside where it is simulated. Raises `UsageError` where a voltage doesn't turn the shaft,
        `UnknownName` for a fact or a data sheet that isn't there.
        """
        from servobench.rig.motor.parameters import data_sheet

        sheet = data_sheet(self.sheet).motor
        resistance = Expression(self.resistance).evaluate(stand.facts).value
        signal = Staircase(levels=self.voltages, dwell=self.dwell)
        update = {"signal": signal, "duration": self.dwell * len(self.voltages)}
        recording = stand.run(stand.experiment.model_copy(update=update))
        truth, levels = truth_if_known(recording), at_levels(recording, self.dwell)
        still = [level.voltage for level in levels if level.speed == 0]
        if still:
            raise UsageError(
                f"the shaft stands still at {still[0]:g} V; expected voltages that overcome the friction"
            )
        k = np.array([(level.voltage - resistance * level.current) / level.speed for level in levels])
        parameters = _parameters(levels, resistance, float(k.mean()), sheet.inertia)
        return StudyResult(
            tables=(_table(levels, k), _all(parameters, truth, sheet)),
            figures=(_figure(levels, parameters),),
            facts={name: Fact(value=value) for name, value in parameters.items()},
        )


def _parameters(levels: Sequence[Level], resistance: float, k: float, inertia: float) -> dict[str, float]:
    """R, k, b, T_c, J, K and τ by name, in SI units."""
    w = np.array([level.speed for level in levels])
    torque = k * np.array([level.current for level in levels])
    x = np.column_stack([w, np.sign(w), np.ones(len(w))])  # an offset of the current sensor is neither
    b, coulomb, _ = (float(value) for value in np.linalg.lstsq(x, torque, rcond=None)[0])
    return {
        "resistance": resistance,
        "motor_constant": k,
        "viscous_friction": b,
        "coulomb_torque": coulomb,
        "inertia": inertia,
        **_reduce_motor(resistance, k, b, inertia),
    }


def _reduce_motor(resistance: float, k: float, b: float, inertia: float) -> dict[str, float]:
    """K = k/(R b + k²) and τ = R J/(R b + k²), without the winding's inductance."""
    drag = resistance * b + k * k
    return {"gain": k / drag, "time_constant": resistance * inertia / drag}


def _table(levels: Sequence[Level], k: Array) -> Table:
    def column(name: str, heading: str, unit: str, values: Sequence[float]) -> Column:
        return Column(name=name, heading=heading, unit=unit, values=tuple(map(float, values)))

    return Table(
        title="The shaft free",
        columns=(
            column("voltage", "v", "V", [level.voltage for level in levels]),
            column("speed", "ω", "rad/s", [level.speed for level in levels]),
            column("current", "i", "A", [level.current for level in levels]),
            column("constant", "(v − R i)/ω", "V·s/rad", list(k)),
        ),
        note=f"Mean of the last column: {plain(float(k.mean()))} V·s/rad.",
    )


_ROWS: tuple[tuple[str, str, str], ...] = (
    ("resistance", "resistance R", "Ω"),
    ("motor_constant", "torque constant k", "V·s/rad"),
    ("viscous_friction", "viscous friction b", "N·m·s/rad"),
    ("coulomb_torque", "Coulomb torque", "N·m"),
    ("inertia", "inertia J, from masses and radii", "kg·m²"),
    ("gain", "gain K = k/(R b + k²)", "rad/(s·V)"),
    ("time_constant", "time constant τ = R J/(R b + k²)", "s"),
)


def _all(parameters: dict[str, float], truth: Truth | None, sheet: MotorParameters) -> Table:
    stated: dict[str, float] = {
        "resistance": sheet.resistance,
        "motor_constant": sheet.motor_constant,
        "inertia": sheet.inertia,
        **_reduce_motor(sheet.resistance, sheet.motor_constant, sheet.viscous_friction, sheet.inertia),
    }
    nothing: Cell = math.nan
    own: tuple[float, ...] = ()
    if truth:
        r, k, b, inertia = truth.resistance, truth.motor_constant, truth.viscous_friction, truth.inertia
        # By the formulas of the rows, as the other columns: the pole itself has the inductance in it.
        true = {**asdict(truth), **_reduce_motor(r, k, b, inertia)}
        own = tuple(true[name] for name, _, _ in _ROWS)
    return Table(
        title="The motor's parameters",
        columns=(
            Column(name="parameter", heading="parameter", values=tuple(label for _, label, _ in _ROWS)),
            Column(
                name="found",
                heading="from the tables",
                values=tuple(parameters[name] for name, _, _ in _ROWS),
            ),
            Column(
                name="sheet",
                heading="data sheet",
                values=tuple(stated.get(name, nothing) for name, _, _ in _ROWS),
            ),
            *((Column(name="true", heading="the motor's own", values=own),) if own else ()),
            Column(name="unit", heading="unit", values=tuple(unit for _, _, unit in _ROWS)),
        ),
        note="A data sheet has no friction.",
    )


def _figure(levels: Sequence[Level], parameters: dict[str, float]) -> Illustration:
    from servobench.lab.graphs import Graph, Line, figure_of

    w = np.array([level.speed for level in levels])
    torque = 1e3 * parameters["motor_constant"] * np.array([level.current for level in levels])
    b, coulomb = 1e3 * parameters["viscous_friction"], 1e3 * parameters["coulomb_torque"]
    most = float(np.abs(w).max())
    sides = [
        Line(x=x, y=b * x + coulomb * np.sign(x), mark="strong", label=label)
        for x, label in ((np.array([-most, -1e-9]), "b ω + T_c sgn(ω)"), (np.array([1e-9, most]), ""))
    ]
    points = Line(x=w, y=torque, mark="points", label="k i")
    return figure_of(
        "friction",
        "Torque against friction",
        "At a steady speed the motor's torque equals friction: a step at rest, and a slope.",
        f"Friction takes {plain(coulomb)} mN·m at any speed, and {plain(1e3 * b)} µN·m more for each rad/s.",
        (Graph(title="Torque (mN·m)", over="speed (rad/s)", lines=(*sides, points)),),
    )

"""The study `solvers`: a step of voltage computed by several solvers and step sizes, compared with the exact solution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.errors import SimulationDiverged
from servobench.core.rounding import plain
from servobench.core.settings import PositiveTime, Settings, Voltage
from servobench.lab.expression import Fact
from servobench.lab.graphs import Graph, Line, Mark, figure_of
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table
from servobench.report.illustrations import Illustration
from servobench.rig.motor.parameters import data_sheet
from servobench.rig.motor.physics import MotorState, Physics
from servobench.rig.motor.solvers.base import SOLVERS

_SPAN = 0.5  # s; five time constants
_AT = 0.1  # s; about one time constant, where the remaining way determines the time constant best


class Case(Settings):
    """One way to compute the motor."""

    solver: str
    """Its name: exact, euler, rk4 or adaptive."""
    step: PositiveTime
    """The step size [s]."""
    inductance: bool = True
    """Whether the winding's inductance is computed; without it the motor is of first order."""


_CASES = (
    Case(solver="euler", step=0.002),
    Case(solver="euler", step=0.0002),
    Case(solver="euler", step=0.00002),
    Case(solver="rk4", step=0.002),
    Case(solver="rk4", step=0.0002),
    Case(solver="exact", step=0.002),
    Case(solver="euler", step=0.002, inductance=False),
    Case(solver="euler", step=0.02, inductance=False),
    Case(solver="rk4", step=0.02, inductance=False),
    Case(solver="exact", step=0.02, inductance=False),
)


class _Row(NamedTuple):
    """A solver's result: the change of a fast disturbance in a step, the largest error of the speed, the time constant."""

    growth: float
    error: Cell
    time_constant: Cell


@STUDIES.member("solvers")
class Solvers(StudySettings):
    """The motor of a data sheet, without friction, after a step of voltage from rest; nothing is run on a device."""

    motor: str = "qube_servo_2"
    """Name of the data sheet."""
    voltage: Voltage = 1.0
    """The step [V]."""
    cases: Annotated[tuple[Case, ...], Field(min_length=1)] = _CASES
    """Solvers and steps, each with the inductance or without it."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table; facts: `electrical` and `mechanical`, the motor's time constants L/R and R J/k², `limit` [s]."""
        whole = Physics.of(data_sheet(self.motor).motor)
        rows = [self._row(case, _physics(whole, case)) for case in self.cases]
        columns = (
            Column(name="solver", heading="solver", values=tuple(case.solver for case in self.cases)),
            Column(name="step", heading="step", unit="ms", values=tuple(1e3 * case.step for case in self.cases)),
            Column(name="winding", heading="inductance", values=tuple("yes" if c.inductance else "left out" for c in self.cases)),
            Column(name="growth", heading="factor in a step", values=tuple(row.growth for row in rows)),
            Column(name="error", heading="largest error", unit="rad/s", values=tuple(row.error for row in rows), digits=3),
            Column(name="apparent", heading="time constant", unit="s", values=tuple(row.time_constant for row in rows), digits=5),
            Column(name="work", heading="steps a second", values=tuple(1 / case.step for case in self.cases)),
        )  # fmt: skip
        table = Table(
            title=f"A step of {plain(self.voltage)} V, computed",
            columns=columns,
            note=(
                "The factor multiplies the motor's fastest mode in one step: above 1 in magnitude it grows, and the "
                "computation diverges. Errors are relative to the exact solution of the motor with its inductance."
            ),
        )
        fastest = max(abs(value) for value in whole.eigenvalues)
        return StudyResult(
            tables=(table,),
            figures=(self._figure(whole),),
            facts={
                "electrical": Fact(value=whole.inductance / whole.resistance),
                "mechanical": Fact(value=whole.resistance * whole.inertia / whole.motor_constant**2),
                "limit": Fact(value=2 / fastest),
            },
        )

    def _row(self, case: Case, physics: Physics) -> _Row:
        fastest = -max(abs(value) for value in physics.eigenvalues)
        growth = _factor(case.solver, fastest * case.step)
        t = _times(case.step)
        try:
            speed = _speeds(case.solver, physics, self.voltage, case.step, len(t))
        except SimulationDiverged:
            return _Row(growth, "diverges", "diverges")
        exact = _exact(Physics.of(data_sheet(self.motor).motor), self.voltage, t)
        error = round(float(np.abs(speed - exact).max()), 12)  # what is smaller is the arithmetic's rounding
        return _Row(growth, error, _apparent_time_constant(t, speed, physics.gain * self.voltage))

    def _figure(self, whole: Physics) -> Illustration:
        """The exact speed, and Euler's with steps that a first-order motor just bears."""
        simple = replace(whole, inductance=0.0)
        shown: Sequence[tuple[float, Mark]] = ((0.002, "strong"), (0.02, "thin"), (0.08, "dashed"))
        lines = []
        fine = np.linspace(0, _SPAN, 400)
        lines.append(Line(x=fine, y=_exact(whole, self.voltage, fine), label="exact", mark="wide"))
        for step, mark in shown:
            t = _times(step)
            speed = _speeds("euler", simple, self.voltage, step, len(t))
            lines.append(Line(x=t, y=speed, label=f"{plain(1e3 * step)} ms", mark=mark))
        return figure_of(
            name="solvers",
            title="Forward Euler on the motor without inductance",
            caption=(
                "A long step makes the motor look faster than it is: the initial slope is held for the "
                "whole step."
            ),
            description="The speed by forward Euler with steps of 2, 20 and 80 ms, and the exact one, which is the slowest.",
            graphs=(Graph(title="Speed (rad/s)", over="time (s)", lines=tuple(lines)),),
        )


def _times(step: float) -> Array:
    """The times (N,) [s] of the steps, from 0 to the last one within the span."""
    return step * np.arange(math.floor(_SPAN / step + 1e-9) + 1, dtype=np.float64)


def _physics(whole: Physics, case: Case) -> Physics:
    return whole if case.inductance else replace(whole, inductance=0.0)


def _factor(solver: str, z: float) -> float:
    """The factor of e^{λt} in one step, with z = λ step: 1 + z by Euler, the fourth-order sum by RK4, else e^z."""
    if solver == "euler":
        return 1 + z
    return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24 if solver == "rk4" else math.exp(z)


def _speeds(solver: str, physics: Physics, voltage: float, step: float, count: int) -> Array:
    """The speeds (N,) [rad/s] at the steps, from rest. Raises `SimulationDiverged`."""
    prepared = SOLVERS[solver].prepare(physics, step, step)
    state = MotorState(0.0, 0.0, 0.0)
    speeds = np.zeros(count)
    for k in range(1, count):
        state = prepared.advance(state, voltage, step)
        speeds[k] = state.speed
    return speeds


def _exact(physics: Physics, voltage: float, t: Array) -> Array:
    """ω(t) = K u (1 - (τ₁ e^{-t/τ₁} - τ₂ e^{-t/τ₂})/(τ₁ - τ₂)) (N,), for the motor's two time constants."""
    slow, fast = (-1 / value.real for value in physics.eigenvalues)
    left = (slow * np.exp(-t / slow) - fast * np.exp(-t / fast)) / (slow - fast)
    return np.asarray(physics.gain * voltage * (1 - left))


def _apparent_time_constant(t: Array, speed: Array, final: float) -> float:
    """The time constant [s] that the speed about 0.1 s after the step shows: -t/ln(1 - ω/ω∞)."""
    k = int(np.argmin(np.abs(t - _AT)))
    return float(-t[k] / np.log(1 - speed[k] / final))

"""The study `step_responses`: controllers tried on a step of the reference, theory beside the run."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.control.base import Controller
from servobench.control.lead import Lead
from servobench.control.pid import Pid
from servobench.errors import UsageError
from servobench.experiment import Experiment
from servobench.experiment.experiment import AnyController
from servobench.lab.loops import (
    Change,
    Course,
    OfAMotor,
    StepFigures,
    change_of,
    course_after,
    figures_of,
    tunable,
    without_friction,
)
from servobench.lab.studies.base import STUDIES, Cell, Column, Shown, Stand, Table
from servobench.report import figures
from servobench.report.figures import Curve, Panel
from servobench.report.illustrations import Illustration
from servobench.rounding import plain

_SHOWN = 4  # courses in the figure
_CHAIN = (
    "derivative | lowpass 50 rad/s"  # through which a speed is looked at, where the experiment has no chain
)


@STUDIES.member("step_responses")
class StepResponses(OfAMotor):
    """Peak time and overshoot for each controller: by the second-order formulas, of the loop without friction, and measured.

    For proportional and derivative feedback of the position, K k_p/(τs² + (1 + K k_d) s + K k_p), so that ω_n = √(K k_p/τ),
    ζ = (1 + K k_d)/(2 √(K k_p τ)), t_p = π/(ω_n √(1 - ζ²)), overshoot e^(-πζ/√(1 - ζ²)).
    """

    controllers: Annotated[tuple[AnyController, ...], Field(min_length=1)]
    """The controllers to try, each as a table [controller] has it."""

    def __call__(self, stand: Stand) -> Shown:
        """Return the table and the courses; raises `UsageError` where the experiment's reference makes no step."""
        gain, tau = self.motor(stand)
        change, chain = change_of(stand.experiment), stand.experiment.chain or _CHAIN
        measured, linear, formulas, courses = [], [], [], []
        for controller in self.controllers:
            law = tunable(controller)
            if controller.reference_unit != stand.experiment.controller.reference_unit:
                raise UsageError("step_responses: all controllers have to follow what the experiment's does")
            asked = stand.experiment.model_copy(update={"controller": controller})
            found = course_after(stand.run(asked), change.start, change.of, chain)
            ideal = without_friction(law, gain, tau, asked, chain)
            measured.append(figures_of(found, change.initial, change.final))
            linear.append(figures_of(ideal, change.initial, change.final))
            formulas.append(_formulas(controller, gain, tau))
            courses.append((controller, found, ideal))
        return Shown(
            tables=self._tables(formulas, linear, measured, change),
            figures=(self._figure(courses[:_SHOWN], change),),
            sentences=_sentences(stand.experiment, measured),
        )

    def _tables(
        self,
        formulas: list[tuple[float, float, float, float]],
        linear: list[StepFigures],
        measured: list[StepFigures],
        change: Change,
    ) -> tuple[Table, ...]:
        unit = change.unit
        numbers = np.array(formulas)
        columns = [
            Column(name="controller", heading="controller", values=tuple(map(_named, self.controllers)))
        ]
        theory = [
            *columns,
            Column(name="frequency", heading="ω_n", unit="rad/s", values=_cells(numbers[:, 0])),
            Column(name="damping", heading="ζ", values=_cells(numbers[:, 1])),
            Column(name="peak_theory", heading="t_p", unit="s", values=_cells(numbers[:, 2])),
            Column(
                name="overshoot_theory", heading="overshoot", unit="%", values=_cells(100 * numbers[:, 3])
            ),
        ]
        ideal = [*columns, *_read("_linear", linear)]
        run = [
            *columns,
            *_read("", measured),
            Column(
                name="error",
                heading="missing at the end",
                unit=unit,
                values=tuple(x.error for x in measured),
                digits=3,
            ),
            Column(
                name="voltage",
                heading="voltage asked for",
                unit="V",
                values=tuple(x.voltage for x in measured),
            ),
        ]
        note = (
            "This is the loop as it runs, with sample time and filter, around a motor without friction and without a "
            "limit of the voltage; the difference to the run is what these two do."
        )
        tables = (
            Table(title=f"Without friction: {change}", columns=tuple(ideal), note=note),
            Table(title=f"In the run: {change}", columns=tuple(run)),
        )
        if not np.isfinite(numbers).any():
            return tables
        return (Table(title="By the formulas of second order", columns=tuple(theory)), *tables)

    def _figure(self, courses: list[tuple[Controller, Course, Course]], change: Change) -> Illustration:
        names = "; ".join(_named(controller) for controller, _, _ in courses)
        return Illustration(
            name="step-responses",
            title="Step responses, measured and without friction",
            caption="Wide and grey: the run. Thin and blue: the same loop around a motor without friction and limits.",
            description=f"Answers to {change} with {names}.",
            draw=partial(figures.time_courses, tuple(_course(*each, change) for each in courses)),
        )


def _read(name: str, found: list[StepFigures]) -> list[Column]:
    """The columns of what is read off step responses."""
    peaks, overshoots = tuple(x.peak_time for x in found), tuple(100 * x.overshoot for x in found)
    rises = tuple(x.rise_time for x in found)
    return [
        Column(name=f"peak{name}", heading="t_p", unit="s", values=peaks, digits=3),
        Column(name=f"overshoot{name}", heading="overshoot", unit="%", values=overshoots, digits=3),
        Column(name=f"rise{name}", heading="rise time", unit="s", values=rises, digits=3),
    ]


def _formulas(controller: Controller, gain: float, tau: float) -> tuple[float, float, float, float]:
    """ω_n, ζ, t_p and overshoot [1] of a second-order loop; NaN for another, or where there is no peak."""
    if not isinstance(controller, Pid) or controller.output != "position" or controller.ki:
        return (math.nan, math.nan, math.nan, math.nan)
    if gain * controller.kp <= 0:
        return (math.nan, math.nan, math.nan, math.nan)
    omega = math.sqrt(gain * controller.kp / tau)
    zeta = (1 + gain * controller.kd) / (2 * math.sqrt(gain * controller.kp * tau))
    if zeta >= 1:
        return (omega, zeta, math.nan, 0.0)
    root = math.sqrt(1 - zeta**2)
    return (omega, zeta, math.pi / (omega * root), math.exp(-math.pi * zeta / root))


def _named(controller: Controller) -> str:
    if isinstance(controller, Pid):
        parts = (("kp", controller.kp), ("ki", controller.ki), ("kd", controller.kd))
        return ", ".join(f"{name} {plain(value)}" for name, value in parts if value)
    if isinstance(controller, Lead):
        return f"lead, gain {plain(controller.gain)}, zero {plain(controller.zero)}, pole {plain(controller.pole)}"
    return type(controller).__name__


def _cells(values: np.ndarray) -> tuple[Cell, ...]:
    return tuple(float(value) for value in values)


def _course(controller: Controller, found: Course, ideal: Course, change: Change) -> figures.Course:
    curves = (
        Curve(t=found.t, y=found.output, look="measured", label="run"),
        Curve(t=ideal.t, y=ideal.output, look="model", label="no friction"),
    )
    return figures.Course(
        title=_named(controller),
        panels=(
            Panel(title=change.of.capitalize(), unit=change.unit, curves=curves),
            Panel(
                title="Voltage",
                unit="V",
                curves=(Curve(t=found.t, y=found.voltage, look="input"),),
                height=80.0,
            ),
        ),
    )


def _sentences(experiment: Experiment, measured: list[StepFigures]) -> tuple[str, ...]:
    limit = experiment.limits.voltage
    beyond = sum(each.voltage > limit for each in measured)
    if not beyond:
        return ()
    return (
        f"With {beyond} of the {len(measured)} controllers more was asked for than the limit of {plain(limit)} V: there the loop "
        "is open, and the formulas don't hold.",
    )

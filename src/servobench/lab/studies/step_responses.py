"""The study `step_responses`: controllers tried on a step of the reference, theory beside the run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.lab.graphs import over_time
from servobench.lab.loops import OfAMotor, gains_text, tunable
from servobench.lab.step_response import (
    Change,
    Response,
    StepFigures,
    change_of,
    figures_of,
    response_after,
    without_friction,
)
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, Table
from servobench.report.figures import Course, Curve, Panel
from servobench.report.illustrations import Illustration
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import AnyController
from servobench.systems.control.base import Controller
from servobench.systems.control.pid import Pid

_SHOWN = 4  # courses in the figure
_NOTE = (
    "‘No friction’ is the loop as it runs, with sample time and filter, around a motor without friction and without "
    "a limit of the voltage; the difference to the run is the effect of these two. Without an overshoot there is no "
    "peak."
)
_CHAIN = (
    "derivative | lowpass 50 rad/s"  # through which a speed is examined, where the experiment has no chain
)


@STUDIES.member("step_responses")
class StepResponses(OfAMotor):
    """Peak time and overshoot for each controller: by the second-order formulas, of the loop without friction, and measured.

    For proportional and derivative feedback of the position, K k_p/(τs² + (1 + K k_d) s + K k_p), so that ω_n = √(K k_p/τ),
    ζ = (1 + K k_d)/(2 √(K k_p τ)), t_p = π/(ω_n √(1 - ζ²)), overshoot e^(-πζ/√(1 - ζ²)) (Franklin, Powell and Emami-Naeini 2015,
    chapter 3).
    """

    controllers: Annotated[tuple[AnyController, ...], Field(min_length=1)]
    """The controllers to try, each as a table [controller] has it."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table and the courses; raises `UsageError` where the experiment's reference makes no step."""
        gain, tau = self.motor(stand)
        change, chain = change_of(stand.experiment), stand.experiment.chain or _CHAIN
        measured, linear, formulas, courses = [], [], [], []
        for controller in self.controllers:
            law = tunable(controller)
            if controller.reference_unit != stand.experiment.controller.reference_unit:
                raise UsageError(
                    "step_responses: all controllers must control the same output as the experiment's"
                )
            experiment = stand.experiment.model_copy(update={"controller": controller})
            response = response_after(stand.run(experiment), change.start, change.of, chain)
            ideal = without_friction(law, gain, tau, experiment, chain)
            measured.append(figures_of(response, change.initial, change.final))
            linear.append(figures_of(ideal, change.initial, change.final))
            formulas.append(_formulas(controller, gain, tau))
            courses.append((response, ideal))
        return StudyResult(
            tables=tuple(table(formulas, linear, measured, change) for table in (self._peaks, self._rest)),
            figures=(_figure(list(zip(_names(self.controllers), courses, strict=True))[:_SHOWN], change),),
            sentences=_sentences(stand.experiment, measured),
        )

    def _peaks(
        self,
        formulas: list[tuple[float, float, float, float]],
        linear: list[StepFigures],
        measured: list[StepFigures],
        change: Change,
    ) -> Table:
        """Peak time and overshoot, by each way to them."""
        numbers = np.array(formulas)
        by_formula = bool(np.isfinite(numbers).any())
        columns = [_controllers(self.controllers)]
        if by_formula:
            columns.append(
                Column(name="peak_theory", heading="t_p, formula", unit="s", values=_cells(numbers[:, 2]))
            )
        columns += [
            Column(
                name="peak_linear",
                heading="t_p, no friction",
                unit="s",
                values=tuple(x.peak_time for x in linear),
                digits=3,
            ),
            Column(
                name="peak",
                heading="t_p, run",
                unit="s",
                values=tuple(x.peak_time for x in measured),
                digits=3,
            ),
        ]
        if by_formula:
            columns.append(
                Column(
                    name="overshoot_theory",
                    heading="overshoot, formula",
                    unit="%",
                    values=_cells(100 * numbers[:, 3]),
                )
            )
        columns += [
            Column(
                name=name,
                heading=heading,
                unit="%",
                values=tuple(100 * x.overshoot for x in step_figures),
                digits=3,
            )
            for name, heading, step_figures in (
                ("overshoot_linear", "overshoot, no friction", linear),
                ("overshoot", "overshoot, run", measured),
            )
        ]
        return Table(title=str(change).capitalize(), columns=tuple(columns), note=_NOTE)

    def _rest(
        self,
        formulas: list[tuple[float, float, float, float]],
        linear: list[StepFigures],
        measured: list[StepFigures],
        change: Change,
    ) -> Table:
        """The poles, where there are two, and what else the responses show."""
        ideal_rises, rises = (tuple(x.rise_time for x in step_figures) for step_figures in (linear, measured))
        errors, voltages = tuple(x.error for x in measured), tuple(x.voltage for x in measured)
        numbers = np.array(formulas)
        columns = [_controllers(self.controllers)]
        if np.isfinite(numbers).any():
            columns += [
                Column(name="frequency", heading="ω_n", unit="rad/s", values=_cells(numbers[:, 0])),
                Column(name="damping", heading="ζ", values=_cells(numbers[:, 1])),
            ]
        columns += [
            Column(
                name="rise_linear", heading="rise time, no friction", unit="s", values=ideal_rises, digits=3
            ),
            Column(name="rise", heading="rise time, run", unit="s", values=rises, digits=3),
            Column(name="error", heading="missing at the end", unit=change.unit, values=errors, digits=3),
            Column(name="voltage", heading="largest voltage asked for", unit="V", values=voltages),
        ]
        return Table(title="How fast, how exact, and at what voltage", columns=tuple(columns))


def _figure(courses: Sequence[tuple[str, tuple[Response, Response]]], change: Change) -> Illustration:
    return over_time(
        "step-responses",
        "Step responses, measured and without friction",
        "Wide and grey: the run. Thin and blue: the same loop around a motor without friction and limits.",
        f"Responses to {change} with {'; '.join(name for name, _ in courses)}.",
        tuple(_course(name, *each, change) for name, each in courses),
    )


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


def _controllers(controllers: Sequence[Controller]) -> Column:
    return Column(name="controller", heading="controller", values=_names(controllers))


def _names(controllers: Sequence[Controller]) -> tuple[str, ...]:
    """The names of the controllers; those that only differ in their filter have it in the name."""
    names = [gains_text(each) for each in controllers]
    return tuple(
        f"{name}, filter {plain(each.cutoff)} rad/s"
        if names.count(name) > 1 and isinstance(each, Pid)
        else name
        for name, each in zip(names, controllers, strict=True)
    )


def _cells(values: np.ndarray) -> tuple[Cell, ...]:
    return tuple(float(value) for value in values)


def _course(name: str, response: Response, ideal: Response, change: Change) -> Course:
    curves = (
        Curve(t=response.t, y=response.output, look="measured", label="run"),
        Curve(t=ideal.t, y=ideal.output, look="model", label="no friction"),
    )
    return Course(
        title=name,
        panels=(
            Panel(title=change.of.capitalize(), unit=change.unit, curves=curves),
            Panel(
                title="Voltage",
                unit="V",
                curves=(Curve(t=response.t, y=response.voltage, look="input"),),
                height=80.0,
            ),
        ),
    )


def _sentences(experiment: Experiment, measured: list[StepFigures]) -> tuple[str, ...]:
    limit = experiment.limits.voltage
    beyond = sum(each.voltage > limit for each in measured)
    if not beyond:
        return ()
    which = "this controller" if len(measured) == 1 else f"{beyond} of the {len(measured)} controllers"
    return (
        f"With {which} the voltage reached the limit of {plain(limit)} V: there the loop is open, and the formulas "
        "don't hold.",
    )

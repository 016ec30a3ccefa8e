"""The study `steady_state_errors`: the remaining error after a step and along a ramp, by theory and by runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.core.settings import Angle, PositiveTime, Speed
from servobench.lab.expression import Expression, Fact
from servobench.lab.graphs import over_time
from servobench.lab.loops import OfAMotor, gains_text
from servobench.lab.step_response import Response, response_after
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, Table
from servobench.report.figures import Course, Curve, Panel
from servobench.report.illustrations import Illustration
from servobench.rig.experiment.experiment import AnyController
from servobench.systems.control.pid import Pid
from servobench.systems.signals.ramp import Ramp
from servobench.systems.signals.step import Step

_LAST = 0.5  # s at the end, over which the error is averaged


@dataclass(frozen=True, kw_only=True, eq=False)
class _Trial:
    """One controller on one reference: the error by theory, the most that friction adds, and what was measured [rad]."""

    law: Pid
    reference: str
    theory: float
    friction: float
    error: float
    course: Response
    wanted: tuple[float, ...]


@STUDIES.member("steady_state_errors")
class SteadyStateErrors(OfAMotor):
    """The error of a position loop after a step and along a ramp r = v t, for P, PD and PI controllers.

    By the final value theorem (Franklin, Powell and Emami-Naeini 2015, chapter 4) with E = (1 - T) R, the derivative acting on
    the position alone: nothing after a step, and along a ramp v (1 + K k_d)/(K k_p) without an integral part, nothing with one.
    Coulomb friction u_c takes another u_c/k_p along a ramp, and leaves up to that after a step, where there is no integral part
    to take it up.
    """

    controllers: Annotated[tuple[AnyController, ...], Field(min_length=1)]
    """The controllers, all pid of the position."""
    coulomb_voltage: str = "0"
    """The voltage that friction takes, an expression over facts [V]."""
    step: Angle = 1.5
    """Height of the step [rad]."""
    slope: Speed = 5.0
    """Slope v of the ramp [rad/s]."""
    duration: PositiveTime = 6.0
    """Length of each run [s]."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return errors by theory and by run, and the courses; raises `UsageError` for other controllers."""
        friction = Expression(self.coulomb_voltage).evaluate(stand.facts).value
        tried = [
            self._try(stand, self._law(c), ramp, friction) for ramp in (False, True) for c in self.controllers
        ]
        columns = (
            Column(name="reference", heading="reference", values=tuple(x.reference for x in tried)),
            Column(name="controller", heading="controller", values=tuple(gains_text(x.law) for x in tried)),
            Column(name="type", heading="system type", values=tuple(2.0 if x.law.ki else 1.0 for x in tried)),
            Column(
                name="theory",
                heading="error, final value theorem",
                unit="rad",
                values=tuple(x.theory for x in tried),
            ),
            Column(
                name="friction",
                heading="friction adds, at most",
                unit="rad",
                values=tuple(x.friction for x in tried),
                digits=3,
            ),
            Column(
                name="error", heading="error in the run", unit="rad", values=tuple(x.error for x in tried)
            ),
        )
        note = f"The error of the run is its mean over the last {plain(_LAST)} s, reference minus position."
        return StudyResult(
            tables=(Table(title="The remaining error", columns=columns, note=note),),
            figures=(_figure(tried),),
            facts={"slope": Fact(value=self.slope), "step": Fact(value=self.step)},
        )  # fmt: skip

    def _law(self, controller: object) -> Pid:
        if isinstance(controller, Pid) and controller.output == "position" and controller.kp > 0:
            return controller
        raise UsageError(
            "steady_state_errors takes controllers of the type pid, of the position, with a kp above 0"
        )

    def _try(self, stand: Stand, law: Pid, ramp: bool, friction: float) -> _Trial:
        gain, _ = self.motor(stand)
        signal = (
            Ramp(final=self.slope * self.duration, duration=self.duration) if ramp else Step(final=self.step)
        )
        experiment = stand.experiment.model_copy(
            update={"controller": law, "signal": signal, "duration": self.duration}
        )
        course = response_after(stand.run(experiment), 0.0, "position", "")
        reference = signal(course.t)
        last = course.t > self.duration - _LAST
        lag = self.slope * (1 + gain * law.kd) / (gain * law.kp) if ramp and not law.ki else 0.0
        return _Trial(
            law=law,
            reference="ramp" if ramp else "step",
            theory=lag,
            friction=0.0 if law.ki else friction / law.kp,
            error=float((reference - course.output)[last].mean()),
            course=course,
            wanted=tuple(map(float, reference)),
        )


def _figure(tried: list[_Trial]) -> Illustration:
    import numpy as np

    courses = tuple(
        Course(
            title=f"{x.reference.capitalize()}: {gains_text(x.law)}",
            panels=(
                Panel(
                    title="Error",
                    unit="rad",
                    curves=(Curve(t=x.course.t, y=np.array(x.wanted) - x.course.output, look="measured"),),
                    height=100.0,
                ),
            ),
        )
        for x in tried
    )
    return over_time(
        name="errors",
        title="The error over time",
        caption="Reference minus position, above for the step and below for the ramp.",
        description="; ".join(f"{x.reference} with {gains_text(x.law)}: {plain(x.error, 3)} rad at the end" for x in tried) + ".",
        courses=courses)  # fmt: skip

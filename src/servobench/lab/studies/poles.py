"""The study `poles`: where the poles of the motor are, how often, and what they mean."""

from __future__ import annotations

from functools import partial

from servobench.core.rounding import plain
from servobench.identification.uncertainty.bands import PoleBand
from servobench.lab.expression import Fact
from servobench.lab.loops import OfAMotor, motor_system
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, Table
from servobench.report.illustrations import Illustration
from servobench.report.model_figures import pole_map
from servobench.systems.stability.verdict import StabilityReport, stability


@STUDIES.member("poles")
class Poles(OfAMotor):
    """Poles, multiplicity and verdict from voltage to speed and from voltage to position, and a bounded input that drives off."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table, a map of the poles, and the reasons in words."""
        gain, tau = self.motor(stand)
        judged = [stability(motor_system(gain, tau, output)) for output in ("speed", "position")]
        columns = (
            Column(name="function", heading="from voltage to", values=("speed ω", "position θ")),
            Column(name="poles", heading="poles (1/s)", values=tuple(map(_places, judged))),
            Column(name="pole", heading="the motor's own", unit="1/s", values=(-1 / tau, -1 / tau)),
            Column(name="verdict", heading="by the poles", values=tuple(j.verdict for j in judged)),
            Column(
                name="bibo",
                heading="BIBO",
                values=tuple("stable" if j.bibo else "unstable" for j in judged),
            ),
        )
        drive = judged[1].drive
        facts = {"growth": Fact(value=drive.coefficient)} if drive else {}
        return StudyResult(
            tables=(Table(title="Poles and what they mean", columns=columns),),
            figures=(_map(-1 / tau),),
            sentences=(*judged[1].reasons, *((drive.sentence,) if drive else ())),
            facts=facts,
        )


def _places(judged: StabilityReport) -> str:
    """The poles with their multiplicity, as a person writes them."""
    return ", ".join(
        plain(pole.real) + (f" ({count} times)" if count > 1 else "")
        for pole, count in zip(judged.poles, judged.multiplicities, strict=True)
    )


def _map(pole: float) -> Illustration:
    band = PoleBand(pole=complex(pole), half=0j)
    return Illustration(
        name="poles",
        title="Poles of the motor",
        caption=(
            "Crosses are poles: the motor's, and at 0 the integrator's from speed to position. The shaded "
            "half is unstable."
        ),
        description=f"Pole map: a pole at {plain(pole)} 1/s, and the integrator's at 0.",
        draw=partial(pole_map, (band,), 0j),
    )

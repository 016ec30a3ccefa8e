"""The study `lead_design`: a lead compensator from a wished crossover and phase margin, step by step."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from servobench.core.errors import UsageError
from servobench.core.settings import Speed
from servobench.lab.expression import Fact
from servobench.lab.loops import OfAMotor
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, Table


@STUDIES.member("lead_design")
class LeadDesign(OfAMotor):
    """Zero, pole and gain of (1 + s/z)/(1 + s/p) for K/(s (τs + 1)), the largest lead put on the crossover.

    As in Franklin, Powell and Emami-Naeini 2015, chapter 6: the motor leaves 90° - arctan(τω) at the crossover ω; what the
    margin lacks is the lead φ. With a = (1 + sin φ)/(1 - sin φ): z = ω/√a, p = ω√a, and the gain makes |L(jω)| = 1:
    ω √(1 + (τω)²)/(K √a).
    """

    crossover: Annotated[Speed, Field(gt=0)]
    """The gain crossover that is wished [rad/s]."""
    phase_margin: Annotated[float, Field(gt=0, lt=90)]
    """The phase margin that is wished [deg]."""
    hold: bool = True
    """Whether what the hold costs, half a sample time, is to be made up for."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the steps of the design; raises `UsageError` where no lead of one stage can make up for what is missing."""
        gain, tau = self.motor(stand)
        omega = self.crossover
        left = 90 - math.degrees(math.atan(tau * omega))
        lost = math.degrees(0.5 * stand.experiment.sample_time * omega) if self.hold else 0.0
        lead = self.phase_margin - left + lost
        if not 0 < lead < 85:
            raise UsageError(
                f"lead_design: a phase margin of {self.phase_margin:g}° at {omega:g} rad/s takes a lead of "
                f"{lead:.1f}°; one stage gives more than 0° and less than 85°: choose another crossover or margin"
            )
        a = (1 + math.sin(math.radians(lead))) / (1 - math.sin(math.radians(lead)))
        steps = {
            "left": ("phase margin without the lead", left, "°"),
            "lost": ("lost to the hold", lost, "°"),
            "lead": ("lead that is needed, φ", lead, "°"),
            "ratio": ("a = pole / zero", a, ""),
            "zero": ("zero", omega / math.sqrt(a), "rad/s"),
            "pole": ("pole", omega * math.sqrt(a), "rad/s"),
            "gain": ("gain", omega * math.sqrt(1 + (tau * omega) ** 2) / (gain * math.sqrt(a)), "V/rad"),
        }
        columns = (
            Column(name="step", heading="", values=tuple(label for label, _, _ in steps.values())),
            Column(name="value", heading="value", values=tuple(value for _, value, _ in steps.values())),
            Column(name="unit", heading="unit", values=tuple(unit for _, _, unit in steps.values())),
        )
        title = f"A lead for {self.phase_margin:g}° at {omega:g} rad/s"
        return StudyResult(
            tables=(Table(title=title, columns=columns),),
            facts={name: Fact(value=value) for name, (_, value, _) in steps.items()},
        )

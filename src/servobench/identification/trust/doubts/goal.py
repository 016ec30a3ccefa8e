"""An input that is the goal of a control loop, not the motor's voltage."""

from __future__ import annotations

from collections.abc import Sequence

from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.models.position_loop.goal import goal_finding
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

OF_A_SHAFT = frozenset({"rad", "rad/s", "m", "m/s"})
"""The units of an input that can't drive a motor, but may be what a loop was told."""


def _about(fit: Fit) -> Sequence[Finding]:
    """A finding on the input of a plain motor's fit; a structure of the loop itself knows what it is."""
    if fit.structure.startswith("position_loop"):
        return ()
    findings = [goal_finding(record.data) for record in fit.records]
    return [finding for finding in findings if finding is not None] or _of_a_loop(fit)


def _of_a_loop(fit: Fit) -> list[Finding]:
    """Whether the input is itself a position or a speed: then it is what a loop was told, and not what drove the motor."""
    unit = fit.records[0].data.input_unit
    if unit not in OF_A_SHAFT:
        return []
    sentence = (
        f"The input is in {unit}, so it is the reference of a control loop. The model then "
        "describes the closed loop, controller included, not the motor; name the voltage's column "
        "with `input=COL:V`."
    )
    return [warning("input-is-reference", sentence, parameters=("gain", "time_constant"))]


DOUBTS.member("goal")(Doubt(codes=("input-is-a-goal", "input-is-reference"), about_fit=_about))

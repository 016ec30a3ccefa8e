"""The 63.2 % reading: the time constant is the time after which the speed has covered 1 - 1/e of a step.

That follows from ω(t) = ω∞ (1 - e^(-t/τ)) at t = τ.
"""

from __future__ import annotations

import math

from servobench.core.channels import Array
from servobench.identification.estimators.base import ESTIMATORS, Abilities
from servobench.identification.estimators.step_reading import CorrectedReading, StepReading
from servobench.identification.estimators.steps import time_at

_PART = 1.0 - math.exp(-1.0)


def time_to_63(t: Array, part: Array) -> float:
    """Return when the part of the way that is covered (N,) at times t (N,) [s] since the step passes 1 - 1/e; NaN where never."""
    return time_at(t, part, _PART)


ESTIMATORS.member("step_63")(
    StepReading(
        "step_63",
        time_to_63,
        Abilities(
            method="reads the time to 63.2 % of each step of the speed; gain and offset from the steady values",
            noise="little: noise isn't modelled, and the measurement's lag is counted as the motor's",
            interval="scatter between steps only; doesn't include the chain's bias",
            position=False,
            speed=True,
            chain=False,
            irregular_times=True,
            several_records=True,
            closed_loop=False,
            delay=False,
            friction=False,
            disturbance=False,
        ),
    )
)

ESTIMATORS.member("step_63_corrected")(
    CorrectedReading(
        "step_63_corrected",
        time_to_63,
        Abilities(
            method="finds the motor that gives step_63's reading when simulated through the measurement chain",
            noise="little: noise isn't modelled",
            interval="scatter between steps only; doesn't include an error common to all of them",
            position=True,
            speed=True,
            chain=True,
            irregular_times=True,
            several_records=True,
            closed_loop=False,
            delay=False,
            friction=False,
            disturbance=False,
        ),
    )
)

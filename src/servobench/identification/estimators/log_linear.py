"""The logarithmic reading: ln(1 - Δω/Δω∞) of a first-order step response is a straight line of slope -1/τ.

That follows from Δω = Δω∞ (1 - e^(-t/τ)).
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import ESTIMATORS, Abilities
from servobench.identification.estimators.step_reading import CorrectedReading, StepReading
from servobench.identification.estimators.steps import time_at

# The line goes from here to there on the way: before, a filter's start bends it; after, noise does.
_FROM, _TO = 0.1, 0.9
_POINTS = 100


def log_slope(t: Array, part: Array) -> float:
    """Return -1 over the slope of ln(1 - part) (N,) by t (N,) [s], least squares from 10 to 90 % of the way.

    At evenly spaced points between the samples, so that the slope of a simulated response doesn't jump where a sample enters that
    range. NaN where there are fewer than three samples on that way, or the slope isn't negative.
    """
    start, end = time_at(t, part, _FROM), time_at(t, part, _TO)
    if np.count_nonzero((t >= start) & (t <= end)) < 3:
        return float("nan")
    when = np.linspace(start, end, _POINTS)
    left = 1.0 - np.interp(when, t, part)
    positive = left > 0
    x, y = when[positive] - when[positive].mean(), np.log(left[positive])
    slope = float(x @ y) / float(x @ x)
    return -1.0 / slope if slope < 0 else float("nan")


ESTIMATORS.member("log_linear")(
    StepReading(
        "log_linear",
        log_slope,
        Abilities(
            method=(
                "reads the slope of ln(1 - Δω/Δω∞) on each step of the speed; gain and offset from the "
                "steady values"
            ),
            noise="little: noise isn't modelled, and part of the measurement's lag is counted as the motor's",
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

ESTIMATORS.member("log_linear_corrected")(
    CorrectedReading(
        "log_linear_corrected",
        log_slope,
        Abilities(
            method="finds the motor that gives log_linear's reading when simulated through the measurement chain",
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

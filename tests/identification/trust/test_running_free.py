"""A motor whose driver lets go of it while it slows down: named by that, and by nothing that it only looks like."""

from __future__ import annotations

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Array
from servobench.core.finding import Verdict
from servobench.identification.result import Result

STEP = 0.002  # s, in which the motor is simulated
GAIN, FRICTION = 0.53, 0.57  # rad/(s·V), V
DRAG = 0.05  # of what the winding brakes a motor with, the bearings' part
PER_RAD = 400.0  # counts


def driven(u: Array, tau: float, lets_go: bool) -> tuple[Array, Array]:
    """Speed and angle (N,) of a motor under inputs u (N,) above zero, whose driver's current may not turn round."""
    speed = angle = 0.0
    speeds, angles = [], []
    for volts in u:
        speeds.append(speed)
        angles.append(angle)
        torque = GAIN * volts - speed * (1.0 - DRAG)
        rate = (max(torque, 0.0) if lets_go else torque) - DRAG * speed - GAIN * FRICTION
        speed = max(speed + STEP / tau * rate, 0.0)
        angle += STEP * speed
    return np.array(speeds), np.array(angles)


def said(holds: tuple[float, ...], tau: float, lets_go: bool, output: str) -> Result:
    """What is said of sweeps from 0 to 95 % of 12 V, as a feed-forward table is taken, each with its own time a level [s]."""
    lengths = np.concatenate([np.full(20, round(hold / STEP)) for hold in holds])
    levels = np.tile(12.0 * np.arange(20) / 20, len(holds))
    rows = np.concatenate([[0], np.cumsum(lengths[:-1])])
    speed, angle = driven(np.repeat(levels, lengths), tau, lets_go)
    noise = 0.03 * np.random.default_rng(4).standard_normal(len(rows))
    arrays = {
        "time": rows * STEP,
        "u": levels,
        "speed": speed[rows] + noise,
        "angle": np.round(PER_RAD * angle[rows]),
    }
    return sb.identify(arrays, input="u:V", output=output, time="time:s")


HOLDS = [(0.05,) * 5, (0.037, 0.062, 0.15), (0.04, 0.08, 0.16)]


@pytest.mark.parametrize("output", ["speed:rad/s", "angle:counts"])
@pytest.mark.parametrize("holds", HOLDS)
def test_a_driver_that_lets_go_is_named(output: str, holds: tuple[float, ...]) -> None:
    result = said(holds, 0.05, True, output)

    codes = {each.code for each in result.findings}
    assert "coasts" in codes
    assert not codes & {"response-oscillates", "kind-mistaken", "fit-by-chance", "motor-changes", "dead-zone"}


@pytest.mark.parametrize("output", ["speed:rad/s", "angle:counts"])
@pytest.mark.parametrize("holds", HOLDS)
def test_a_driver_that_brakes_is_not(output: str, holds: tuple[float, ...]) -> None:
    result = said(holds, 0.05, False, output)

    assert "coasts" not in {each.code for each in result.findings}
    assert result.verdict is Verdict.TRUSTED


@pytest.mark.parametrize(("per_rad", "left"), [(5.0, 0.0), (20.0, 0.0), (80.0, 0.0), (20.0, 0.1)])
def test_what_a_coast_tells_of_gain_and_friction_depends_on_the_driver(per_rad: float, left: float) -> None:
    """A step, and then next to no input: a driver that lets go of the motor leaves a line, which another gain nearly makes."""
    u = np.where(np.arange(1000) < 700, 4.7, left)
    _, angle = driven(u, 0.2, lets_go=True)
    result = sb.identify(
        {"u": u[::5], "angle": np.floor(per_rad * angle[::5])},
        input="u:V",
        output="angle:counts",
        counts_per_rev=2 * np.pi * per_rad,
        sample_time=5 * STEP,
        starts_at_rest=True,
    )

    gain = result.to_dict()["parameters"]["gain"]
    assert gain["state"] != "known"
    assert result.fit is not None
    assert any(line.source == "a driver that lets go" for line in result.fit.budget)

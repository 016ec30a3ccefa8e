"""A bridge that is switched off at zero duty: named by that, and not where it brakes there, or where nothing moves."""

from __future__ import annotations

import numpy as np
import pytest

import servobench as sb
from servobench.identification.result import Result

STEP = 1e-4  # s, in which the motor is simulated
EVERY = 50  # of these steps there is a row
GAIN, TAU, FRICTION = 20.0, 0.1, 0.6  # rad/(s·V), s, V
DRAG = 0.05  # of what the winding brakes a motor with, the bearings' part
LEVELS = np.array([0.0, 4.0, 8.0, 0.0, 6.0, 10.0, 0.0, 3.0, 0.0, 9.0, 5.0, 0.0])  # V, each for 0.4 s


def said(coasts: bool, levels: np.ndarray = LEVELS) -> Result:
    """What is said of a motor behind such a bridge, by an encoder of 2000 counts."""
    u = np.repeat(levels, round(0.4 / STEP))
    speed = angle = 0.0
    angles = np.empty(len(u))
    for k, volts in enumerate(u):
        angles[k] = angle
        torque = GAIN * volts - (0.0 if coasts and volts == 0.0 else (1.0 - DRAG) * speed)
        speed = max(speed + STEP / TAU * (torque - DRAG * speed - GAIN * FRICTION), 0.0)
        angle += STEP * speed
    counts = np.floor(angles[::EVERY] * 2000 / (2 * np.pi))
    arrays = {"time": STEP * EVERY * np.arange(len(counts)), "u": u[::EVERY], "ticks": counts}
    return sb.identify(arrays, input="u:V", output="ticks:counts", counts_per_rev=2000)


def test_a_bridge_that_is_switched_off_at_zero_is_named() -> None:
    (found,) = [each for each in said(True).findings if each.code == "coasts"]

    assert "hile its input is zero the motor coasts" in found.sentence


@pytest.mark.parametrize("levels", [LEVELS, LEVELS + 1.0])
def test_one_that_brakes_is_not(levels: np.ndarray) -> None:
    assert "coasts" not in {each.code for each in said(False, levels).findings}

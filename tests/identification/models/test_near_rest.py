"""Friction that is larger near rest: its derivative against the motor's equation, marched in short steps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.models.near_rest import by_excess_friction

GAIN, TAU, OFFSET, COULOMB, DELAY, START = 20.0, 0.05, 0.1, 0.6, 0.013, 5.0
WIDTH = 6.0  # rad/s
STEP, TICK = 1e-4, 0.007  # s
SAMPLES = 200
INPUTS = np.random.default_rng(1).choice([-3.0, -0.3, 0.5, 2.0, 3.0], 14)
HOLD = 0.1  # s


def marched(excess: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angle and speed of a motor whose friction has so many volts more at rest, falling to nothing at `WIDTH`.

    A step has the friction of its middle; one in which the speed changes its sign is taken in two.
    """

    def end(speed: float, volts: float, sense: float) -> float:
        return GAIN * (volts - sense * (COULOMB + excess * max(0.0, 1.0 - abs(speed) / WIDTH)))

    def after(speed: float, volts: float, sense: float, h: float) -> float:
        before = end(speed, volts, sense)
        middle = end(before + (speed - before) * math.exp(-0.5 * h / TAU), volts, sense)
        return middle + (speed - middle) * math.exp(-h / TAU)

    angle, speed, now = 0.0, START, 0.0
    angles, speeds = [angle], [speed]
    for sample in range(1, SAMPLES):
        while now < sample * TICK - 1e-12:
            acting = math.floor((now - DELAY) / HOLD + 1e-9)
            change = (acting + 1) * HOLD + DELAY
            h = min(STEP, sample * TICK - now, change - now if change - now > 1e-12 else STEP)
            volts = (INPUTS[acting] if acting >= 0 else 0.0) - OFFSET
            left = h
            if speed != 0.0:
                new = after(speed, volts, math.copysign(1.0, speed), left)
                part = 1.0 if new * speed >= 0.0 else speed / (speed - new)
                angle += 0.5 * part * left * (speed + (new if part == 1.0 else 0.0))
                speed, left = (new, 0.0) if part == 1.0 else (0.0, (1.0 - part) * left)
            if speed == 0.0 and left > 0.0 and abs(volts) > COULOMB + excess:
                speed = after(0.0, volts, math.copysign(1.0, volts), left)
                angle += 0.5 * left * speed
            now += h
        angles.append(angle)
        speeds.append(speed)
    return np.array(angles), np.array(speeds)


@pytest.mark.parametrize("of", [0, 1], ids=["angle", "speed"])
def test_the_derivative_is_what_a_little_more_friction_does(of: int) -> None:
    """Through starts, stops, reversals and rests; a difference over 0.01 V, of steps that err by (1e-4/0.05)² of 60 rad/s."""
    little = 0.01
    difference = (marched(little)[of] - marched(0.0)[of]) / little

    found = np.empty(SAMPLES)
    p = np.array([GAIN, TAU, OFFSET, COULOMB, DELAY, 0.0, START])
    times = HOLD * np.arange(len(INPUTS))
    by_excess_friction(times, INPUTS, 0.0, TICK * np.arange(SAMPLES), p, WIDTH, float(of), found)

    assert np.abs(found).max() > 0.1
    np.testing.assert_allclose(found, difference, atol=0.02 * np.abs(found).max())

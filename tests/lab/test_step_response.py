"""Readings off step responses that are known."""

import math

import numpy as np
import pytest

from servobench.lab.step_response import Response, figures_of, without_friction
from servobench.rig.experiment import Experiment
from servobench.systems.control.pid import Pid
from servobench.systems.signals.base import Signal
from servobench.systems.signals.ramp import Ramp
from servobench.systems.signals.step import Step

T = np.arange(0.0, 2.0, 0.001)


def response(zeta: float, omega: float) -> Response:
    """The second-order step response 1 - e^(-ζωt) (cos ω_d t + ζω/ω_d sin ω_d t), below ζ = 1."""
    damped = omega * math.sqrt(1 - zeta**2)
    y = 1 - np.exp(-zeta * omega * T) * (np.cos(damped * T) + zeta * omega / damped * np.sin(damped * T))
    return Response(t=T, output=y, voltage=np.zeros_like(T))


def test_peak_and_overshoot_are_those_of_the_formulas() -> None:
    found = figures_of(response(0.5, 20.0), 0.0, 1.0)

    assert found.peak_time == pytest.approx(math.pi / (20 * math.sqrt(0.75)), abs=5e-4)  # half a sample
    # Half a sample beside a peak costs ½ ω² (h/2)² of it at the most.
    assert found.overshoot == pytest.approx(
        math.exp(-math.pi * 0.5 / math.sqrt(0.75)), abs=0.5 * 400 * 5e-4**2
    )


def test_an_overshoot_that_nobody_can_see_is_none() -> None:
    """e^(-πζ/√(1-ζ²)) is 7e-10 for ζ = 0.989: the rounding of a calculation, and no peak."""
    found = figures_of(response(0.989, 20.0), 0.0, 1.0)

    assert found.overshoot == 0.0
    assert math.isnan(found.peak_time)


def test_an_overshoot_of_a_hundredth_is_one() -> None:
    """e^(-πζ/√(1-ζ²)) = 1/100 for ζ = 0.826."""
    zeta = math.log(100) / math.hypot(math.pi, math.log(100))
    # As above, half a sample beside the peak.
    assert figures_of(response(zeta, 20.0), 0.0, 1.0).overshoot == pytest.approx(
        0.01, abs=0.5 * 400 * 5e-4**2
    )


K, TAU, H = 20.0, 0.1, 0.002


def followed(signal: Signal, kp: float, ticks: int) -> np.ndarray:
    """The angle at each tick of K/(s(τs + 1)) behind u = kp (r - θ), each voltage held for a tick, from the signal's start on."""
    kept = math.exp(-H / TAU)
    course = np.empty(ticks)
    angle, speed = float(signal(np.array([0.0]))[0]), 0.0
    for k in range(ticks):
        course[k] = angle
        end = K * kp * (float(signal(np.array([k * H]))[0]) - angle)
        angle += end * H + (speed - end) * TAU * (1 - kept)
        speed = end + (speed - end) * kept
    return course


def test_a_step_from_anywhere_is_followed_as_the_loop_does_tick_by_tick() -> None:
    step = Step(initial=1.0, final=3.0, start=0.1)
    asked = Experiment(signal=step, controller=Pid(kp=2.0), duration=0.6, sample_time=H)

    found = without_friction(Pid(kp=2.0), K, TAU, asked, "")

    expected = followed(step, 2.0, 301)[50:]  # the step is at the 50th tick
    # The study's angle is in steps of 1e-9 rad, each of which the loop passes on, and not more.
    np.testing.assert_allclose(found.output, expected[: len(found.output)], rtol=0, atol=1e-8)


def test_the_speed_behind_a_ramp_is_that_of_the_loop_tick_by_tick() -> None:
    ramp = Ramp(initial=0.0, final=2.5, start=0.1, duration=0.5)
    asked = Experiment(signal=ramp, controller=Pid(kp=2.0), duration=0.6, sample_time=H)

    found = without_friction(Pid(kp=2.0), K, TAU, asked, "derivative")

    expected = np.diff(followed(ramp, 2.0, 301), prepend=0.0)[50:] / H
    # Differences of angles that are right to a few 1e-9 rad, over 2 ms.
    np.testing.assert_allclose(found.output, expected[: len(found.output)], rtol=0, atol=5e-6)

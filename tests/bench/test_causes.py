"""Causes are named where they are there: not on plain motors, nor on real recordings that don't have them.

The motors and recordings are those of `bench/causes.py`, which measures the rates; those listed here were told wrong once.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from causes_parts.known import cases, real_ones
from causes_parts.motors import PlainMotor, drawn, recorded, simulated
from causes_parts.told import plain

# The numbers of motors that were told one of these: a weight, two masses, a dead zone, hysteresis, clocks, another sign.
ONCE_ACCUSED = (2, 11, 21, 26, 27, 29, 38, 156, 168, 199, 206, 213)


@pytest.mark.parametrize("number", ONCE_ACCUSED)
def test_a_plain_motor_is_told_no_cause(number: int) -> None:
    (told,) = plain([number])

    assert told.codes == (), told.sentences


def test_the_motors_of_the_bench_are_what_algebra_says() -> None:
    """A step with friction and delay: θ(t) = K (u - u_c) (t - d - τ (1 - e^(-(t - d)/τ))), to rounding."""
    motor = PlainMotor(
        gain=20.0,
        time_constant=0.1,
        coulomb=0.5,
        delay=0.0034,
        sample_time=0.002,
        samples=500,
        amplitude=3.0,
        torque=0.0,
        noise=0.0,
        counts=2048,
        input="step",
        output="rad",
        start="rest",
    )
    speed, angle = simulated(motor, np.full(500, 3.0), np.random.default_rng(0))
    t = np.maximum(np.arange(500) * 0.002 - 0.0034, 0.0)

    assert speed == pytest.approx(20 * 2.5 * -np.expm1(-t / 0.1), abs=1e-9)
    assert angle - angle[0] == pytest.approx(20 * 2.5 * (t + 0.1 * np.expm1(-t / 0.1)), abs=1e-9)


def test_a_motor_of_the_bench_stops_where_algebra_says() -> None:
    """From 40 rad/s at no volts, with a final speed of -20·0.5 rad/s it stands after τ ln(1 + 40/10)."""
    motor = drawn(np.random.default_rng(1))
    fields = {
        "gain": 20.0,
        "time_constant": 0.1,
        "coulomb": 0.5,
        "delay": 0.0,
        "sample_time": 0.001,
        "torque": 0.0,
    }
    motor = type(motor)(**{**motor.__dict__, **fields})
    u = np.where(np.arange(3000) < 2000, 2.5, 0.0)
    speed, _ = simulated(motor, u, np.random.default_rng(0))
    stopped = 2.0 + 0.1 * np.log(1 + 40.0 / 10.0)

    assert speed[2000] == pytest.approx(40.0, rel=1e-6)
    assert speed[int(stopped / 0.001)] > 0
    assert (speed[int(stopped / 0.001) + 1 :] == 0).all()


def test_a_motor_is_drawn_again_from_its_seed() -> None:
    one, other = (recorded(drawn(np.random.default_rng(5)), np.random.default_rng(6)) for _ in range(2))

    assert np.array_equal(one.y, other.y)
    assert np.array_equal(one.u, other.u)


@pytest.mark.parametrize(
    "name",
    [
        "fra233/2026-02-06_20-01-36_Sine_pi_2.mat",
        "fra233/2026-02-06_20-09-36_Sine_2pi.mat",
        "fra233/2026-02-06_19-57-16_Ramp.mat",
        "slow_ticks/motor-direito.csv",
        "swerve_sysid/12_12_Swerve.json#slow-backward",
        "romi_sysid/romi_sysid_data20221106-172256.json#slow-forward",
        "qube3 together",
    ],
)
def test_a_real_recording_is_told_no_cause_that_is_not_its_own(
    name: str, real_data: Callable[[str], Path]
) -> None:
    real_data("emps/DATA_EMPS.mat")  # skips where there are none
    judged = real_ones(among=[case for case in cases() if case.name == name])

    assert judged
    assert [each.false for each in judged] == [()] * len(judged), [each.told.sentences for each in judged]

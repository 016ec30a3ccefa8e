"""A shaft that moves and rests again under a constant input is reported; one that friction stops, or that turns on, isn't."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.identify import identify
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

CODE = "shaft-comes-to-rest"
Array = NDArray[np.float64]


def codes(record: Dataset) -> set[str]:
    return {each.code for each in identify(record).findings}


def made(t: Array, u: Array, y: Array, **changes: object) -> Dataset:
    noisy = y + 1e-3 * np.random.default_rng(1).standard_normal(len(t))
    return replace(
        dataset(seed=1, samples=len(t), u=u, y=noisy),
        t_input=t,
        t_output=t,
        quantum=None,
        input_unit="%",
        **changes,
    )


def followed(target: Array, step: float, tau: float = 0.06) -> Array:
    """The position of a servo that follows its target with a lag."""
    y = np.empty(len(target))
    y[0] = target[0]
    for n in range(1, len(target)):
        y[n] = target[n - 1] + (y[n - 1] - target[n - 1]) * np.exp(-step / tau)
    return y


def motor(
    u: Array, step: float, friction: float, speed: float = 0.0, gain: float = 3.0, tau: float = 0.15
) -> Array:
    """The position of a motor with Coulomb friction, in steps of a twentieth of a sample."""
    y, angle = np.empty(len(u)), 0.0
    for n, volts in enumerate(u):
        y[n] = angle
        for _ in range(20):
            lost = friction * np.sign(speed) if speed else np.clip(volts, -friction, friction)
            new = speed + step / 20 / tau * (gain * (volts - lost) - speed)
            speed = 0.0 if new * speed < 0.0 and abs(volts) <= friction else new
            angle += step / 20 * speed
    return y


@pytest.mark.parametrize("before", [1, 20])
def test_a_hobby_servo_under_a_command_in_percent_is_reported(before: int) -> None:
    u = np.where(np.arange(60) < before + 4, 20.0, 90.0)
    assert CODE in codes(made(0.05 * np.arange(60), u, followed(np.deg2rad(u), 0.05)))


def test_a_motor_that_turns_on_is_none_whatever_the_times_of_its_rows() -> None:
    """100 rows in 10 s, and 600 in the last 0.6 s: three quarters of the rows have a twentieth of the way."""
    t = np.concatenate([0.1 * np.arange(100), 10.0 + 0.001 * np.arange(600)])
    u = np.where(t < 0.5, 0.0, 30.0)
    turned = np.maximum(t - 0.5, 0.0)
    assert CODE not in codes(made(t, u, 28.0 * (turned - 0.1 * -np.expm1(-turned / 0.1))))


def test_a_motor_that_coasts_into_the_friction_of_a_level_is_none() -> None:
    """12 % for 20 ms and then 1 %, of which friction takes 1.5 %."""
    t = 0.002 * np.arange(600)
    u = np.select([t < 0.2, t < 0.22], [0.0, 120.0], 10.0)
    assert CODE not in codes(made(t, u, motor(u, 0.002, 15.0)))


def test_a_record_that_begins_while_the_shaft_coasts_shows_no_change_of_the_input() -> None:
    t = 0.002 * np.arange(900)
    u = np.where(t < 1.2, 10.0, 0.0)
    y = np.floor(motor(u, 0.002, 15.0, speed=7.0) / 0.01) * 0.01
    assert CODE not in codes(replace(made(t, u, y), y=y))


def test_where_the_driver_was_switched_off_that_is_said_once() -> None:
    t = 0.005 * np.arange(500)
    y = motor(np.where((t > 0.5) & (t < 1.2), 60.0, 0.0), 0.005, 5.0)
    found = codes(replace(made(t, np.where(t > 0.5, 60.0, 0.0), y), y=np.floor(y / 0.01) * 0.01))

    assert "output-stops" in found
    assert CODE not in found

"""A motor that turns, under an input that stays as it is, neither turns round nor stops."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Array
from servobench.core.finding import Finding
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

T = 0.01 * np.arange(500)
RISES = 20.0 * -np.expm1(-T / 0.1)  # rad/s


def record(speed: Array, u: float = 5.0) -> Dataset:
    """A speed [rad/s] with noise under an input that stays."""
    noisy = speed + 0.4 * np.random.default_rng(1).standard_normal(len(speed))
    like = dataset(
        seed=1, samples=len(speed), sample_time=0.01, u=np.full(len(speed), u), y=np.zeros(len(speed))
    )
    return replace(like, y=noisy, kind="speed", output_unit="rad/s", quantum=None)


def findings(data: Dataset) -> list[Finding]:
    return list(DOUBTS["motion_reversed"].about_data([data]))


def test_a_way_back_is_reported_with_the_rows_that_can_be_used() -> None:
    (finding,) = findings(record(np.where(T < 2.5, RISES, np.where(T < 2.8, 0.0, -19.0))))

    assert finding.code == "motion-reversed"
    assert "from 2.8 s on" in finding.sentence
    assert "rows up to 2.49 s" in finding.sentence


def test_a_stop_is_reported_with_the_rows_that_can_be_used() -> None:
    (finding,) = findings(record(np.where(T < 4.0, RISES, 0.0)))

    assert finding.code == "motion-stopped"
    assert "rows up to 3.99 s" in finding.sentence


@pytest.mark.parametrize("step", [1e-3, 0.05])
def test_so_is_that_of_a_position_whose_sensor_is_coarse_and_flickers(step: float) -> None:
    """The smoothed speed of steps of 3 degrees, which flicker at rest, comes to rest over a quarter of a second."""
    t = 0.002 * np.arange(500)
    angle = np.minimum(6.0 * t, 5.0) + 0.3 * step * np.random.default_rng(1).standard_normal(len(t))
    like = dataset(seed=1, samples=len(t), u=np.full(len(t), 5.0), y=step * np.rint(angle / step))

    (finding,) = findings(replace(like, quantum=step))

    assert finding.code == "motion-stopped"
    assert re.search(r"rows up to 0\.8[0-9]* s", finding.sentence)


@pytest.mark.parametrize(
    "data",
    [
        pytest.param(record(RISES), id="a step"),
        pytest.param(record(RISES, 0.0), id="no input"),
        pytest.param(record(20.0 - RISES, 1e-3), id="coasts to rest slowly"),
        pytest.param(record(10.0 * np.exp(-T) * np.sin(6.0 * T)), id="a pendulum that swings"),
        pytest.param(record(8.0 * np.sin(1.3 * T)), id="a spring that swings slowly"),
        pytest.param(record(RISES * np.exp(-T / 0.8)), id="a weight that is lifted to its balance"),
        pytest.param(record(np.where(T < 2.5, 0.0, 20.0)), id="a start that comes late"),
    ],
)
def test_no_other_motion_is(data: Dataset) -> None:
    assert findings(data) == []


def test_an_input_that_changes_may_turn_the_motor_round() -> None:
    data = record(np.where(T < 2.5, RISES, -RISES))

    assert findings(replace(data, u=np.where(T < 2.5, 5.0, -5.0))) == []


def test_a_goal_is_reached_and_left_again() -> None:
    data = record(np.where(T < 4.0, RISES, 0.0))

    assert findings(replace(data, input_unit="rad/s")) == []

"""Gain and friction that one level of the input can't tell apart end at a friction that motors have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.estimators.least_squares import Minimum, lowest, minimise
from servobench.identification.estimators.usual_friction import with_usual_friction
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

ONE_WAY = STRUCTURES["first_order_one_way"]


def held_at(share: float, data: Dataset) -> Minimum:
    """The minimum with a friction that takes a share of the largest input."""
    start = lowest(ONE_WAY, [data], ONE_WAY.guesses([data])).theta.copy()
    level = float(np.abs(data.u).max())
    start[0] *= (level - start[2]) / (level * (1.0 - share))
    start[2] = share * level
    return minimise(ONE_WAY, [data], start, np.arange(len(start)) != 2)


@pytest.mark.parametrize(("share", "usual"), [(0.95, 0.5), (-3.0, 0.0), (0.2, 0.2)])
def test_a_friction_beyond_that_of_motors_is_set_to_the_limit_at_the_same_speed(
    share: float, usual: float
) -> None:
    data = dataset(seed=1, samples=1000, u=np.full(1000, 3.0))
    found = held_at(share, data)

    end = with_usual_friction(ONE_WAY, [data], found)

    assert end.theta[2] == pytest.approx(3.0 * usual)
    speed, before = (each.theta[0] * (3.0 - each.theta[2]) for each in (end, found))
    # Rounding of 2048 counts a turn over 2 s at 60 rad/s.
    assert speed == pytest.approx(before, rel=1e-4)


def test_two_levels_tell_the_friction_themselves() -> None:
    data = dataset(seed=1, samples=1000, u=np.where(np.arange(1000) < 500, 3.0, 2.0))
    found = held_at(0.95, data)

    assert with_usual_friction(ONE_WAY, [data], found) is found


def test_what_is_held_stays_while_the_friction_becomes_usual() -> None:
    """A delay that was taken from its prior isn't looked for again."""
    data = dataset(seed=1, samples=1000, u=np.full(1000, 3.0))
    found = held_at(-3.0, data)
    delay = [parameter.name for parameter in ONE_WAY.parameters].index("delay")
    numbers = np.arange(len(found.theta))
    start = np.where(numbers == delay, 0.001, found.theta)
    moved = minimise(ONE_WAY, [data], start, (numbers != 2) & (numbers != delay))

    held, looked_for = (with_usual_friction(ONE_WAY, [data], moved, held) for held in ((delay,), ()))

    assert held.theta[2] == looked_for.theta[2] == 0.0
    assert held.theta[delay] == 0.001
    assert looked_for.theta[delay] != 0.001


def test_one_level_that_a_delay_is_expected_for_has_a_usual_friction() -> None:
    """A speed in noise, of a motor that turns already and whose input rises by a hundredth in the first row."""
    t = 0.002 * np.arange(45)
    y = 63.0 - 28.0 * np.exp(-t / 0.028) + 0.8 * np.random.default_rng(3).standard_normal(45)
    u = np.where(np.arange(45) < 1, 98.8, 100.0)
    data = replace(dataset(seed=1, samples=45, u=u, y=y, chain="derivative"), input_before=98.8)

    fit = ESTIMATORS["output_error"].fit(ONE_WAY, [data])

    assert "delay-expected" in {finding.code for finding in fit.findings}
    assert 0.0 <= fit.model["coulomb_voltage"] <= 50.0


def test_friction_never_drives_the_motor_however_much_better_that_fits() -> None:
    """A row at rest, a speed that rises along a line and stays: so would a motor do that its friction drives during the delay."""
    t = 0.001 * np.arange(153)
    y = 14.9 * np.clip(t / 0.018, 0.0, 1.0) + np.random.default_rng(1).normal(0.0, 0.3, 153)
    record = replace(
        dataset(seed=1, samples=153, u=np.where(t < 0.0005, 0.0, 100.0)),
        t_input=t,
        t_output=t,
        y=y,
        kind="speed",
        output_unit="rad/s",
        quantum=None,
    )
    found = lowest(ONE_WAY, [record], ONE_WAY.guesses([record]))
    assert found.theta[2] > 100.0

    end = with_usual_friction(ONE_WAY, [record], found)

    assert 0.0 <= end.theta[2] <= 50.0
    assert end.theta[0] > 0.0

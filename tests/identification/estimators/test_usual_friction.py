"""Gain and friction that one level of the input can't tell apart end at a friction that motors have."""

from __future__ import annotations

import numpy as np
import pytest

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

"""A sine under friction has a minimum for each way in which samples and reversals meet."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.least_squares import lowest
from servobench.identification.estimators.one_sine import with_neighbours
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
from tests.identification.choice.test_noise_choice import BESIDE, GAIN, one_sine

COULOMB = STRUCTURES["first_order_coulomb"]
NAMES = [parameter.name for parameter in COULOMB.parameters]


def rotated() -> Dataset:
    """A sine that friction of a fifth of it stops at each reversal, counted coarsely for as long as two seconds."""
    t = 0.002 * np.arange(1000)
    data = dataset(seed=3, samples=1000, u=3.0 * np.sin(2 * np.pi * 4.0 * t))
    coarse = 8 * QUANTUM
    return replace(data, y=(np.floor(data.y / coarse) + 0.5) * coarse, quantum=coarse)


def test_the_lowest_of_the_neighbours_is_kept_and_the_others_are_known() -> None:
    data = [rotated()]
    here = lowest(COULOMB, data, COULOMB.guesses(data))
    best = with_neighbours(COULOMB, data, here)

    assert best.cost <= here.cost
    costs = [cost for _, cost in best.others]
    assert best.cost <= min(costs)
    assert len(costs) == len(here.others) + 4


def test_a_lower_minimum_beside_the_one_where_a_search_ended_is_found() -> None:
    data = [one_sine()]
    here = lowest(COULOMB, data, [BESIDE])
    best = with_neighbours(COULOMB, data, here)

    assert best.cost < 0.95 * here.cost
    assert best.theta[NAMES.index("gain")] == pytest.approx(GAIN, rel=0.02)
    assert any(np.array_equal(theta, here.theta) for theta, _ in best.others)


def test_other_inputs_and_motors_without_friction_are_left_as_they_are() -> None:
    prbs, sine = [dataset(seed=1, kind="prbs", samples=500)], [rotated()]
    for structure, data in ((COULOMB, prbs), (STRUCTURES["first_order"], sine)):
        here = lowest(structure, data, structure.guesses(data))
        assert with_neighbours(structure, data, here) is here

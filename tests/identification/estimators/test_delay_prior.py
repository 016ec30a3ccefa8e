"""The way between two places that explain the data equally well, as the delay changes from one to the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.delay_prior import prior_of_delay, slope_with_delay
from servobench.identification.estimators.least_squares import lowest
from servobench.identification.models.base import STRUCTURES
from tests.datasets import dataset

ONE_WAY = STRUCTURES["first_order_one_way"]


@pytest.mark.parametrize("apart", [1e-9, 1e-5, 1e-3])
def test_two_places_with_one_delay_have_no_way_between_them(apart: float) -> None:
    """The prior's scale is 10 ms: a fiftieth of that is as far apart as two delays have to be."""
    data = dataset(seed=1, samples=300)
    place = lowest(ONE_WAY, [data], ONE_WAY.guesses([data]))
    prior = prior_of_delay(ONE_WAY, [data])
    assert prior is not None
    change = np.zeros(len(place.theta))
    change[[0, prior.at]] = 0.1, apart

    slope = slope_with_delay(replace(place, theta=place.theta + change), place, prior)

    if apart < 2e-4:
        assert slope is None
    else:
        assert slope is not None
        np.testing.assert_allclose(slope[[0, prior.at]], [0.1 / apart, 1.0])

"""A motor that one level of the input moved, and a little of others: its gain goes with friction, which is at its bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.friction_range import SOURCE, with_friction_range
from servobench.identification.uncertainty.identifiability import State
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

STEP, TAU = 0.05, 0.06  # s
GAIN, FRICTION = 98.0, 1.2  # rad/(s·V), V
ONE_WAY = STRUCTURES["first_order_one_way_rest"]


def held_by_a_loop(seed: int) -> Dataset:
    """A speed at 0.05 s that a loop brings up with 5 V and holds near 4 V, with noise of 8 rad/s once it turns."""
    random = np.random.default_rng(seed)
    u = np.concatenate([np.zeros(5), [5.0, 5.0, 3.2, 3.6], 3.9 + 0.12 * random.standard_normal(14)])
    keep = np.exp(-STEP / TAU)
    speed = GAIN * lfilter([0.0, 1 - keep], [1, -keep], np.maximum(u - FRICTION, 0.0))
    y = speed + np.where(speed > 0, 8.0 * random.standard_normal(len(u)), 0.0)
    plain = dataset(seed=0, u=u, y=y, samples=len(u), sample_time=STEP)
    return replace(plain, kind="speed", output_unit="rad/s", quantum=None)


def fitted(data: Dataset) -> Fit:
    return ESTIMATORS["output_error"].fit(ONE_WAY, [data])


@pytest.mark.parametrize("seed", [4, 13, 17, 27])
def test_gain_and_friction_are_known_together_where_the_search_ends_at_no_friction(seed: int) -> None:
    """Without rest, the zeros before the start seemed to say that nothing is lost: 67 ± 5 rad/(s·V) for the seeds 4 and 17."""
    result = identify(held_by_a_loop(seed))

    assert result.fit is not None
    assert result.answers["gain"].state is State.COMBINATION
    speed = next(each for each in result.combinations if each.name == "speed_at_level")
    assert speed.input_level is not None
    low, high = speed.estimate.interval
    assert low <= GAIN * (speed.input_level - FRICTION) <= high


def test_the_budget_has_what_friction_at_its_bound_leaves_open() -> None:
    fit = fitted(held_by_a_loop(13))
    assert fit.model["coulomb_voltage"] == pytest.approx(0.0, abs=1e-6)
    far = fit["coulomb_voltage"].interval[1]
    assert far > 0.5  # V

    wider = with_friction_range(fit)

    (line,) = (each for each in wider.budget if each.source == SOURCE)
    at = fit.model.names.index("gain")
    # Along K (u - u_c) at 4 V the gain grows by K/4 for each volt of friction.
    assert np.sqrt(line.covariance[at, at]) == pytest.approx(far / 1.96 * fit.model["gain"] / 4.0, rel=0.3)
    assert wider["gain"].interval[1] > fit.model["gain"] * 4.0 / (4.0 - far) * 0.9
    assert wider["coulomb_voltage"].interval == fit["coulomb_voltage"].interval


def test_friction_that_is_known_adds_nothing() -> None:
    fit = ESTIMATORS["output_error"].fit(
        STRUCTURES["first_order_coulomb"], [dataset(seed=1, kind="prbs", samples=1500)]
    )

    assert with_friction_range(fit) is fit

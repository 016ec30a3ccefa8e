"""A step that may act before or after a sample leaves a minimum on either side of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.delay_across import with_delay_across
from servobench.identification.estimators.least_squares import lowest
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

STEP = 0.01  # s
GAIN, TAU = 9.5, 0.07  # rad/(s·V), s
FIRST_ORDER = STRUCTURES["first_order"]


def steps(delay: float, seed: int = 3, noise: float = 0.4) -> Dataset:
    """A noisy speed after two steps of the voltage, which act `delay` [s] late, by the exact solution of the first order."""
    t = STEP * np.arange(90)
    u = np.where(t < 0.3, -4.7, 4.5)
    since = np.clip(t - 0.3 - delay, 0.0, None)
    speed = GAIN * np.where(t < 0.3 + delay, -4.7, 4.5 - 9.2 * np.exp(-since / TAU))
    y = speed + noise * np.random.default_rng(seed).standard_normal(len(t))
    plain = dataset(seed=0, u=u, y=y, samples=len(t), sample_time=STEP)
    return replace(plain, kind="speed", output_unit="rad/s", quantum=None, input_before=-4.7)


def with_early_answer(data: Dataset) -> Dataset:
    """The record whose first sample after the step answers to more of it than a motor of first order would."""
    y = data.y.copy()
    y[31] += 3.0
    return replace(data, y=y)


@pytest.mark.parametrize("delay", [0.0105, 0.0115])
def test_a_search_from_either_side_of_a_sample_ends_in_the_lower_minimum(delay: float) -> None:
    data = with_early_answer(steps(delay))
    starts = [np.array([GAIN, TAU, 0.0, at, -44.0]) for at in (0.006, 0.014)]
    minima = [lowest(FIRST_ORDER, [data], [start]) for start in starts]
    assert (
        abs(minima[0].cost - minima[1].cost) > 1.0
    )  # (rad/s)²: one is lower, for the one delay this, for the other that

    ends = [with_delay_across(FIRST_ORDER, [data], minimum) for minimum in minima]

    assert min(each.cost for each in minima) == pytest.approx(ends[0].cost, rel=1e-6)
    assert ends[1].cost == pytest.approx(ends[0].cost, rel=1e-6)


def test_the_higher_minimum_stands_beside_the_lower_one() -> None:
    data = steps(0.0095)
    minimum = lowest(FIRST_ORDER, [data], [np.array([GAIN, TAU, 0.0, 0.006, -44.0])])

    best = with_delay_across(FIRST_ORDER, [data], minimum)

    assert best.cost <= minimum.cost
    assert len(best.others) > len(minimum.others)


def test_a_delay_that_no_sampling_instant_is_near_to_is_left_alone() -> None:
    data = steps(0.005, noise=0.01)
    minimum = lowest(FIRST_ORDER, [data], [np.array([GAIN, TAU, 0.0, 0.006, -44.0])])

    assert with_delay_across(FIRST_ORDER, [data], minimum) is minimum

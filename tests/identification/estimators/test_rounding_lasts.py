"""A coarse encoder on a shaft that rests again and again: its counts are taken for the bins that they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.choice.noise_choice import with_counts_as_bins
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.reference import Truth, march
from tests.truth.test_intervals import answers

COARSE = 2 * np.pi / 64


def resting(seed: int) -> Dataset:
    """Levels both ways with rests between them, each for 0.2 to 0.6 s, behind 64 counts in a turn."""
    random = np.random.default_rng(seed)
    levels = np.repeat(random.choice([-3.0, -1.5, 0.0, 1.5, 3.0], 40), random.integers(100, 300, 40))[:3000]
    angle = march(Truth(inductance=1e-9), levels, 0.002, angle=random.uniform(0.0, COARSE))[:, 2]
    y = (np.floor(angle / COARSE) + 0.5) * COARSE
    return replace(dataset(seed=seed, samples=3000, u=levels, y=y), quantum=COARSE)


def by_output_error(data: Dataset) -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])


@pytest.mark.parametrize("seed", range(1, 5))
def test_counts_taken_as_bins_say_more_and_hold_the_truth(seed: int) -> None:
    plain = by_output_error(resting(seed))
    counted = with_counts_as_bins(plain)

    assert counted.estimator == "interval_likelihood"
    assert "rounding-lasts" in {finding.code for finding in counted.findings}
    true = answers(Truth(inductance=1e-9))
    for name in ("gain", "time_constant"):
        assert abs(counted.model[name] - true[name]) < 3 * counted.sd(name)
    assert counted.sd("gain") * counted.sd("time_constant") < 0.64 * plain.sd("gain") * plain.sd(
        "time_constant"
    )


def test_identify_chooses_it_and_an_estimator_that_was_asked_for_stays() -> None:
    chosen, asked = identify(resting(1)).fit, identify(resting(1), estimator="output_error").fit

    assert chosen is not None
    assert asked is not None
    assert chosen.estimator == "interval_likelihood"
    assert asked.estimator == "output_error"


def test_where_the_rounding_is_white_output_error_stays() -> None:
    plain = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [dataset(seed=1)])

    assert with_counts_as_bins(plain) is plain


def test_where_a_random_torque_acts_besides_output_error_stays() -> None:
    data = resting(1)
    shaken = march(Truth(inductance=1e-9), data.u, 0.002, torque_noise=1e-4, step=5e-5, seed=1)[:, 2]
    plain = by_output_error(replace(data, y=(np.floor(shaken / COARSE) + 0.5) * COARSE))

    assert with_counts_as_bins(plain) is plain

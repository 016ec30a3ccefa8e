"""The form in which friction falls with the speed is in the intervals of a model that supposes one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.fall_of_friction import OTHER_FALL, SOURCE, with_fall_of_friction
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.odd_motor import OddMotor, marched

STEP, SAMPLES, NOISE = 0.005, 1000, 3e-4  # s, samples, rad
GAUSSIAN = OddMotor(gain=20.0, coulomb=0.4, stribeck=0.2, stribeck_speed=3.0, gaussian=1.0)
EXPONENTIAL = GAUSSIAN._replace(gaussian=0.0)


def levels(random: np.random.Generator) -> NDArray[np.float64]:
    return np.repeat(random.uniform(-2.0, 2.0, SAMPLES // 20), 20)


def record(seed: int, truth: OddMotor, noise: float = NOISE) -> Dataset:
    random = np.random.default_rng(seed)
    u = levels(random)
    y = marched(truth, u, STEP)[:, 0] + noise * random.standard_normal(SAMPLES)
    return replace(dataset(seed=seed, u=u, samples=SAMPLES, sample_time=STEP, y=y), quantum=None)


def fitted(
    seed: int, truth: OddMotor, structure: str = "first_order_coulomb_stribeck", noise: float = NOISE
) -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES[structure], [record(seed, truth, noise)])


def misses(fits: list[Fit]) -> int:
    """The number of Coulomb voltages that are off by more than the 95 % interval."""
    return sum(
        abs(fit["coulomb_voltage"].value - GAUSSIAN.coulomb) > 1.96 * fit["coulomb_voltage"].sd
        for fit in fits
    )


def test_the_line_covers_friction_that_falls_with_the_square_of_the_speed() -> None:
    """The model's friction falls in proportion to it. Of 8 intervals that hold 95 % three or more miss once in 170."""
    fits = [fitted(seed, GAUSSIAN) for seed in range(8)]

    assert misses(fits) >= 3
    assert misses([with_fall_of_friction(fit) for fit in fits]) <= 2


def test_the_line_says_what_it_is_for() -> None:
    (line,) = with_fall_of_friction(fitted(0, GAUSSIAN)).budget

    assert line.source == SOURCE
    assert line.freedom == np.inf


@pytest.mark.parametrize("structure", ["first_order", "first_order_coulomb"])
def test_a_model_without_such_a_friction_has_no_such_line(structure: str) -> None:
    fit = fitted(1, EXPONENTIAL, structure)

    assert with_fall_of_friction(fit) is fit


@pytest.mark.parametrize("seed", [5, 25])
def test_another_form_of_the_fall_is_no_other_drag(seed: int) -> None:
    """The same residual looks like a drag that isn't linear, by which the gain would be unknown."""
    result = identify(record(seed, GAUSSIAN))

    assert result.fit is not None
    assert result.fit.structure == "first_order_coulomb_stribeck"
    assert OTHER_FALL in {finding.code for finding in result.findings}
    assert "drag that isn't linear" not in {line.source for line in result.fit.budget}
    low, high = result.fit["gain"].interval
    assert low < GAUSSIAN.gain < high < low + 0.2 * GAUSSIAN.gain


@pytest.mark.parametrize("seed", [1, 17, 39])
def test_a_search_ends_where_its_own_residual_is_explained(seed: int) -> None:
    """Without friction that falls the residual is a hundred times larger: what is little beside that was where it ended."""
    result = identify(record(seed, EXPONENTIAL))

    assert result.fit is not None
    assert result.fit.structure == "first_order_coulomb_stribeck"
    assert result.fit["gain"].value == pytest.approx(GAUSSIAN.gain, rel=1e-3)

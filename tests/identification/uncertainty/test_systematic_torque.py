"""A torque that depends on the motion is told from one that doesn't, and widens the intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.choice.noise_choice import allow_for_disturbance
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.friction_near_rest import with_friction_near_rest
from servobench.identification.uncertainty.model_error import model_error
from servobench.identification.uncertainty.systematic_torque import systematic_share
from tests.datasets import dataset, prbs
from tests.rig.motor.reference import Truth

GAIN, TAU, FRICTION = 20.0, 0.08, 0.25  # rad/(s·V), s, V
STEP, SAMPLES, SUBSTEPS = 0.002, 5000, 40


def turned(u: NDArray[np.float64], excess: float, narrow: float) -> NDArray[np.float64]:
    """The angle of a motor whose friction falls from more at rest, (1 + excess) times, with the speed; in steps of 50 µs."""
    angle, speed, h = 0.0, 0.0, STEP / SUBSTEPS
    found = np.empty(len(u))
    for n, volts in enumerate(u.tolist()):
        found[n] = angle
        for _ in range(SUBSTEPS):
            brake = h / TAU * GAIN * FRICTION * (1.0 + excess * np.exp(-abs(speed) / narrow))
            free = speed + h / TAU * (GAIN * volts - speed)
            new = free - min(brake, max(-brake, free))
            angle += 0.5 * h * (speed + new)
            speed = new
    return found


def fitted(y: NDArray[np.float64] | None, u: NDArray[np.float64], seed: int, torque: float = 0.0) -> Fit:
    quantum = 2 * np.pi / 2048
    data = dataset(
        seed=seed, u=u, y=None if y is None else quantum * np.round(y / quantum), torque_noise=torque
    )
    return allow_for_disturbance(
        ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [replace(data, quantum=quantum)])
    )


@pytest.fixture(scope="module")
def stribeck() -> Fit:
    """A sine of 3 V and 0.8 Hz, and 40 % more friction at rest."""
    u = 3.0 * np.sin(2 * np.pi * 0.8 * STEP * np.arange(SAMPLES))
    return fitted(turned(u, 0.4, 4.0), u, 1)


def test_friction_of_another_course_is_taken_for_a_torque_that_depends_on_the_motion(stribeck: Fit) -> None:
    assert stribeck.disturbance is not None
    assert systematic_share(stribeck) == 1.0


def test_then_the_record_shows_that_the_model_is_wrong(stribeck: Fit) -> None:
    found = model_error(stribeck)
    assert found is not None
    assert all(share == 1.0 for share in found.shares.values())


def test_and_the_friction_near_rest_is_left_open(stribeck: Fit) -> None:
    """By itself the estimator misses the gain by far."""
    wider = with_friction_near_rest(stribeck)

    assert abs(stribeck["gain"].value - GAIN) > 3 * stribeck["gain"].sd
    assert abs(wider["gain"].value - GAIN) < 1.96 * wider["gain"].sd
    assert abs(wider["time_constant"].value - TAU) < 1.96 * wider["time_constant"].sd


@pytest.mark.parametrize("seed", range(1, 7))
def test_a_torque_that_is_random_depends_on_nothing(seed: int) -> None:
    """Chance reaches 3.5 standard deviations of χ², where it begins to count, in less than one of 500 records."""
    fit = fitted(None, prbs(SAMPLES, 50, np.random.default_rng(seed)), seed, torque=1e-5)

    assert fit.disturbance is not None
    assert systematic_share(fit) == 0.0


@pytest.mark.parametrize(("seed", "torque"), [(2, 1e-5), (3, 1e-6)])
def test_a_shaft_that_friction_holds_shows_no_torque(seed: int, torque: float) -> None:
    """It stops somewhat beside where the model has it, and all samples of that rest err in the same sense."""
    u = np.repeat(np.random.default_rng(seed).choice([0.0, 3.0], SAMPLES // 250), 250)
    data = dataset(seed=seed, u=u, torque_noise=torque, truth=Truth(coulomb_torque=8e-4))
    fit = allow_for_disturbance(
        ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way_rest"], [data])
    )
    assert np.mean(np.diff(data.y) == 0) > 0.3

    assert fit.disturbance is not None
    assert systematic_share(fit) == 0.0


@pytest.mark.parametrize(("seed", "torque"), [(1, 1e-7), (2, 1e-7), (4, 1e-6)])
def test_the_samples_of_a_slow_shaft_within_one_step_of_an_encoder_are_one_error(
    seed: int, torque: float
) -> None:
    """256 steps in a turn, of which the shaft passes one in up to twenty samples where it turns back."""
    quantum = 2 * np.pi / 256
    u = 0.6 * np.sin(2 * np.pi * 0.2 * STEP * np.arange(SAMPLES))
    data = dataset(seed=seed, u=u, torque_noise=torque, truth=Truth(coulomb_torque=8e-4))
    coarse = replace(data, y=quantum * np.round(data.y / quantum), quantum=quantum)
    fit = allow_for_disturbance(ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [coarse]))

    assert fit.disturbance is not None
    assert systematic_share(fit) == 0.0

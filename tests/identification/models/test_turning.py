"""What friction leaves of a deviation of the speed: two shafts that differ a little, and the filter that follows them."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.turning import Sliding
from tests.datasets import dataset

GAIN, TAU, COULOMB = 20.0, 1.0, 0.3  # rad/(s·V), s, V
STEP, SAMPLES, SUBSTEPS = 0.005, 1200, 100  # s, samples, steps in each
LEVEL, HALF_PERIOD = 1.5, 40  # V, samples: it turns back five times while a deviation dies away
TORQUE, NOISE = 0.004, 1e-4  # V √s, rad: a wander of 0.06 rad/s, read nearly without noise
Array = NDArray[np.float64]


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def turned(u: Array, pushes: Array, start: float) -> tuple[Array, Array]:
    """Angle and speed at the samples of a motor with Coulomb friction under random torques, in steps of 50 µs."""
    h, angle, speed = STEP / SUBSTEPS, 0.0, start
    angles, speeds = np.empty(len(u)), np.empty(len(u))
    for n, volts in enumerate(u):
        angles[n], speeds[n] = angle, speed
        for k in range(SUBSTEPS):
            free = speed + h / TAU * (GAIN * (volts + pushes[n, k]) - speed)
            brake = h / TAU * GAIN * COULOMB
            new = free - min(brake, max(-brake, free))
            angle += 0.5 * h * (speed + new)
            speed = new
    return angles, speeds


def square() -> Array:
    return LEVEL * np.where(np.arange(SAMPLES) // HALF_PERIOD % 2, -1.0, 1.0)


def test_what_is_left_is_what_two_shafts_differ_by_after_a_reversal() -> None:
    """(1.5 - 0.3)/(1.5 + 0.3) of it, by the input that turns the shaft round; the samples of the turn are those of the sign."""
    quiet, theta = np.zeros((SAMPLES, SUBSTEPS)), np.array([GAIN, TAU, COULOMB, 0.0, 0.0, 0.0, 0.0])
    data = replace(
        dataset(seed=0, u=square(), samples=SAMPLES, sample_time=STEP, y=np.zeros(SAMPLES)), quantum=None
    )
    found = STRUCTURES["first_order_coulomb"].sliding(theta, data)
    (_, one), (_, other) = (turned(square(), quiet, start) for start in (0.0, 0.05))
    turns = np.flatnonzero(one[1:] * one[:-1] < 0) + 1

    assert np.flatnonzero((found.left > 0) & (found.left < 1)).tolist() == turns.tolist()
    # The rate is taken as constant over a sample, of a two-hundredth of τ.
    assert found.left[turns] == pytest.approx(2 / 3, rel=STEP / TAU)
    # The other one turns 1.4 ms later, perhaps in the next sample; in the simulator friction acts in steps of 0.3 mrad/s.
    first = turns[0]
    apart = (other - one)[[first - 1, first + 1]]
    assert apart[1] / apart[0] == pytest.approx(2 / 3 * np.exp(-2 * STEP / TAU), rel=2 * 3e-4 / apart[1])
    # The rate before the turn is 3/2 of that after it.
    before, after = np.abs(one[turns - 1]), np.abs(one[turns])
    part = before / (before + 1.5 * after)
    assert found.turns[turns] - data.t_output[turns - 1] == pytest.approx(part * STEP, abs=STEP * STEP / TAU)


def test_a_shaft_that_stops_keeps_nothing_and_one_that_slides_on_keeps_all() -> None:
    speed = np.array([3.0, 2.0, 0.5, 0.0, 0.0, 1.0, 2.0])
    found = Sliding.of_speed(speed, STEP * np.arange(7), 200.0)

    assert found.left.tolist() == [1, 1, 1, 0, 0, 1, 1]
    assert found.turns[3] == pytest.approx(2.5 * STEP)


def test_a_negative_friction_of_a_search_leaves_all_of_it() -> None:
    found = Sliding.of_speed(np.array([1.0, -1.0]), np.array([0.0, STEP]), -5.0)
    assert found.left.tolist() == [1, 1]


def test_a_trial_that_runs_away_draws_no_warning() -> None:
    """pytest makes an error of one; a search met such a speed on a real recording, and its user read NumPy's words."""
    speed = np.array([1.0, -1.0, 1e300, -1e300, 0.0, np.inf, -np.inf, np.nan])
    found = Sliding.of_speed(speed, STEP * np.arange(8), 200.0)

    # Before the turn at 1 rad/s the rate is 100 (3 + √5) rad/s², of which 200 are friction's.
    assert found.left[[1, 4]] == pytest.approx([1 - 2 / (3 + np.sqrt(5)), 0])


def fitted(seed: int) -> Fit:
    random = np.random.default_rng(seed)
    pushes = TORQUE / np.sqrt(STEP / SUBSTEPS) * random.standard_normal((SAMPLES, SUBSTEPS))
    angle, _ = turned(square(), pushes, 0.0)
    y = angle + NOISE * random.standard_normal(SAMPLES)
    data = replace(dataset(seed=seed, u=square(), samples=SAMPLES, sample_time=STEP, y=y), quantum=None)
    return ESTIMATORS["prediction_error"].fit(STRUCTURES["first_order_coulomb"], [data])


def test_intervals_cover_where_a_random_torque_acts_on_a_shaft_that_turns_back() -> None:
    """Errors over standard deviations have a mean square of 1 ± 4 √(2/30): twice as much, or a third, is another law."""
    runs = 30
    fits = [fitted(seed) for seed in range(runs)]
    true = {"gain": GAIN, "time_constant": TAU, "coulomb_voltage": COULOMB, "offset_voltage": 0.0}
    errors = {
        name: np.array([(fit[name].value - value) / fit.sd(name) for fit in fits])
        for name, value in true.items()
    }
    assert {
        name: float(np.mean(e**2)) for name, e in errors.items() if np.mean(e**2) > 1 + 4 * np.sqrt(2 / runs)
    } == {}

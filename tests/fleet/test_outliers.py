"""The odd ones are found, and the others aren't accused."""

import numpy as np
import pytest
from scipy.stats import chi2

from servobench.fleet.outliers import distances, farthest_plain

MIX = np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0], [-0.5, 0.3, 0.4]])
"""Parameters that go together, as gain and time constant do."""


def plain_motors(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, 3)) @ MIX.T + [20.0, 0.1, -3.0]


def test_distances_of_normal_motors_follow_chi() -> None:
    """The share of d² below the χ² quantile q has the sd sqrt(q (1-q)/n) = 0.7 % at the median; a scale that is off by the 1.2
    % of a median absolute deviation of 5,000 moves it by about as much again: four times the sum."""
    n = 5000
    d = distances(plain_motors(n, 1), np.zeros((n, 3)))

    for q in (0.25, 0.5, 0.75):
        assert (d**2 < chi2.ppf(q, 3)).mean() == pytest.approx(q, abs=4 * 0.015)


def test_scale_and_unit_of_a_parameter_do_not_matter() -> None:
    x = plain_motors(500, 2)

    np.testing.assert_allclose(
        distances(x, np.zeros_like(x)), distances(x * [1e3, 1e-6, 1.0], np.zeros_like(x)), rtol=1e-6
    )


def test_a_fifth_of_odd_motors_hide_none_of_each_other() -> None:
    """They are 20 sd away in what the third parameter has by itself; mean and covariance of all would have them at 2 sd."""
    x = plain_motors(300, 3)
    x[:60] += np.array([0.0, 0.0, 20.0]) * 0.4
    d = distances(x, np.zeros_like(x))
    plain = x - x.mean(axis=0)
    classic = np.sqrt(np.einsum("ni,ni->n", plain, np.linalg.solve(np.cov(x.T), plain.T).T))

    assert classic[:60].max() < farthest_plain(300, 3)
    assert d[:60].min() > farthest_plain(300, 3)
    assert (d[60:] > farthest_plain(300, 3)).sum() <= 1


@pytest.mark.parametrize("count", [12, 60, 400])
def test_one_fleet_in_a_hundred_accuses_somebody(count: int) -> None:
    """Of 200 fleets without an odd motor 2 are expected; Poisson with that mean exceeds 7 once in a thousand. The bound is
    itself from 1000 fleets, or for infinitely many motors: allow as many again."""
    accused = sum(
        bool((distances(plain_motors(count, seed), np.zeros((count, 3))) > farthest_plain(count, 3)).any())
        for seed in range(200)
    )

    assert accused <= 14


def test_a_motor_that_is_hardly_known_is_no_outlier() -> None:
    x, u = plain_motors(100, 4), np.full((100, 3), 0.01)
    x[0, 0] += 20.0
    u[0, 0] = 20.0
    d = distances(x, u)

    assert d[0] < farthest_plain(100, 3)
    u[0, 0] = 0.01
    assert distances(x, u)[0] > farthest_plain(100, 3)


@pytest.mark.parametrize("count", [0, 1, 7])
def test_few_motors_say_nothing(count: int) -> None:
    assert np.isnan(distances(plain_motors(count, 5), np.zeros((count, 3)))).all()


def test_motors_that_are_all_the_same_say_nothing() -> None:
    assert np.isnan(distances(np.ones((20, 2)), np.zeros((20, 2)))).all()


def test_parameters_that_are_one_and_the_same_do_no_harm() -> None:
    x = plain_motors(50, 6)[:, [0, 0]]

    assert np.isfinite(distances(x, np.zeros_like(x))).all()

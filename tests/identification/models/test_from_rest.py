"""A motor from rest, sampled evenly: against SciPy's filters, the general kernel, differences, and the truth."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from servobench.identification.models import kernels
from servobench.identification.models.from_rest import fit_from_rest, normal_equations

STEP = 0.002
TRUE = np.array([23.81, 0.0998, 0.3])
EPS = float(np.finfo(float).eps)
Array = NDArray[np.float64]


def voltage(samples: int = 2000) -> Array:
    t = STEP * np.arange(samples)
    return 3 * np.sign(np.sin(2 * np.pi * 0.4 * t)) + 2 * np.sin(2 * np.pi * 1.1 * t)


def position(p: Array, u: Array) -> Array:
    """The position by the filter of a pole, K (1 - a)/(z - a), and the exact integral θ = ∫ K u - τ ω."""
    gain, tau, start = p
    a = np.exp(-STEP / tau)
    speed = lfilter([0.0, gain * (1 - a)], [1.0, -a], u)
    driven = np.concatenate([[0.0], np.cumsum(gain * u[:-1])])
    return np.asarray(start + STEP * driven - tau * speed)


def evaluated(p: Array, u: Array, y: Array) -> tuple[Array, Array, float]:
    h, g = np.empty((3, 3)), np.empty(3)
    return h, g, normal_equations(u, y, STEP, p, h, g)


def test_the_residual_is_that_of_a_filter() -> None:
    u = voltage()
    y = position(TRUE, u)
    h, g, cost = evaluated(np.array([20.0, 0.13, 0.0]), u, y)
    r = y - position(np.array([20.0, 0.13, 0.0]), u)
    # M steps of a recurrence, each rounded: M eps of the largest position.
    rounding = len(u) * EPS * np.abs(y).max()
    assert cost == pytest.approx(float(r @ r), abs=2 * rounding * np.abs(r).sum())
    assert g[2] == pytest.approx(float(r.sum()), abs=len(u) * rounding)
    assert h[2, 2] == len(u)


def test_the_normal_equations_are_those_of_the_general_kernel() -> None:
    u, t = voltage(), STEP * np.arange(2000)
    y = position(TRUE, u)
    p = np.array([20.0, 0.13, 0.1])
    h, g, cost = evaluated(p, u, y)
    whole = np.array([p[0], p[1], 0.0, 0.0, 0.0, p[2], 0.0])
    columns = np.array([kernels.GAIN, kernels.TAU, kernels.POSITION])
    both = kernels.normal(t, u, 0.0, t, y, whole, 0.0, 0.0, columns)

    tolerance = 100 * len(u) * EPS
    np.testing.assert_allclose(h, both[:3, :3], rtol=tolerance)
    np.testing.assert_allclose(g, both[:3, 3], rtol=tolerance, atol=tolerance * np.abs(both[:3, 3]).max())
    assert cost == pytest.approx(both[3, 3], rel=tolerance)


@pytest.mark.parametrize("at", range(3))
def test_the_gradient_is_that_of_differences(at: int) -> None:
    u = voltage()
    y, p = position(TRUE, u), np.array([20.0, 0.13, 0.1])
    step = np.zeros(3)
    step[at] = 1e-5 * p[at]
    slope = (evaluated(p + step, u, y)[2] - evaluated(p - step, u, y)[2]) / (2 * step[at])
    # dr'r/dp = -2 J'r; a truncation error of (1e-5)² of the third derivative, and rounding of eps/1e-5 of the cost.
    assert -2 * evaluated(p, u, y)[1][at] == pytest.approx(slope, rel=1e-6)


def test_a_fit_finds_the_truth() -> None:
    u = voltage()
    p = np.array([20.0, 0.13, 0.0])
    steps = fit_from_rest(u, position(TRUE, u), STEP, p, 30)

    # Two passes over all samples at the most follow what the first eighth says.
    assert 1 <= steps <= 2
    np.testing.assert_allclose(p, TRUE, rtol=1e-9)


def test_a_fit_to_counts_is_where_no_step_of_a_general_search_leads_away() -> None:
    quantum = 2 * np.pi / 2048
    u = voltage()
    y = (np.floor(position(TRUE, u) / quantum) + 0.5) * quantum
    p = np.array([20.0, 0.13, 0.0])
    fit_from_rest(u, y, STEP, p, 30)

    h, g, cost = evaluated(p, u, y)
    sd = np.sqrt(np.diag(np.linalg.inv(h)) * cost / (len(u) - 3))
    assert (np.abs(np.linalg.solve(h, g)) < 1e-6 * sd).all()
    # Rounding that is nearly white: six standard deviations at the most.
    assert (np.abs(p - TRUE) < 6 * sd).all()


def test_a_motor_that_rests_through_the_first_eighth_is_fitted_all_the_same() -> None:
    u = voltage()
    u[: len(u) // 6] = 0.0
    p = np.array([20.0, 0.13, 0.0])

    assert fit_from_rest(u, position(TRUE, u), STEP, p, 30) > 2
    np.testing.assert_allclose(p, TRUE, rtol=1e-9)


def test_noise_that_hides_the_motor_in_the_first_eighth_leads_no_fit_astray() -> None:
    """There the steps of the search from the first samples are wild; the fit is where that from all of them ends."""
    u = voltage()
    part = len(u) // 8
    u[:part] *= 1e-3
    random = np.random.default_rng(1)
    for _ in range(50):
        y = position(TRUE, u) + random.normal(0.0, 0.05, len(u))
        p = np.array([20.0, 0.13, 0.0])

        assert fit_from_rest(u, y, STEP, p, 30) > 0

        h, g, _ = evaluated(p, u, y)
        sd = 0.05 * np.sqrt(np.diag(np.linalg.inv(h)))
        assert (np.abs(np.linalg.solve(h, g)) < 1e-3 * sd).all()
        assert (np.abs(p - TRUE) < 6 * sd).all()


def test_a_shaft_that_never_moves_settles_nowhere() -> None:
    u = np.zeros(100)
    assert fit_from_rest(u, np.zeros(100), STEP, np.array([20.0, 0.13, 0.0]), 30) == -1

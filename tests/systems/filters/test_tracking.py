"""Tracking filters, against SciPy's difference equations and the Kalman filter as textbooks step it."""

import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.signal import lfilter

from servobench.core.errors import UsageError
from servobench.recordings.measurement.base import Chain
from servobench.systems.filters.base import SpeedEstimate
from servobench.systems.filters.tracking import AlphaBeta, MotorKalman

T, STEP = 0.002, 2 * np.pi / 2048
TIMES = T * np.arange(1500)


def path() -> np.ndarray:
    return np.cumsum(np.random.default_rng(3).normal(size=len(TIMES))) * STEP


def test_an_alpha_beta_filter_is_its_transfer_function() -> None:
    alpha, beta, x = 0.3, 0.05, path()

    found = AlphaBeta(alpha=alpha, beta=beta)(x, TIMES)

    expected = lfilter([beta / T, -beta / T], [1, alpha + beta - 2, 1 - alpha], x - x[0])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_a_critically_damped_one_is_a_difference_behind_two_equal_low_passes() -> None:
    x, pole = path(), math.exp(-T / 0.01)

    found = AlphaBeta.critically_damped(0.01, T)(x, TIMES)

    once = lfilter([1 - pole], [1, -pole], np.diff(x, prepend=x[0]) / T)
    twice = lfilter([1 - pole], [1, -pole], once)
    np.testing.assert_allclose(found, twice, rtol=0, atol=1e-10 * np.abs(twice).max())


@pytest.mark.parametrize("acceleration", [1.0, 100.0, 10_000.0])
def test_the_steady_kalman_filter_has_the_gains_of_the_riccati_equation(acceleration: float) -> None:
    advance, seen = np.array([[1, T], [0, 1]]), np.array([[1.0, 0.0]])
    driven = acceleration * np.array([[T**2 / 2], [T]])
    ahead = solve_discrete_are(advance.T, seen.T, driven @ driven.T, np.array([[STEP**2 / 12]]))
    gains = ahead[:, 0] / (ahead[0, 0] + STEP**2 / 12)

    found = AlphaBeta.kalman(acceleration, STEP, T)

    # The equation's solver is right to 1e-9 or so of its numbers, which span nine orders of magnitude.
    assert (found.alpha, found.beta) == pytest.approx((gains[0], gains[1] * T), rel=1e-5)


def test_the_motors_kalman_filter_is_what_the_recursion_settles_to() -> None:
    """Covariances carried from sample to sample, as Kalman's paper has them, until they no longer change."""
    tau, acceleration = 0.1, 10.0
    e = math.exp(-T / tau)
    advance = np.array([[1, tau * (1 - e)], [0, e]])
    driven = acceleration * np.array([[T**2 / 2], [T]])
    p = np.eye(2)
    for _ in range(20_000):
        p = advance @ p @ advance.T + driven @ driven.T
        gain = p[:, 0] / (p[0, 0] + STEP**2 / 12)
        p = p - np.outer(gain, p[0])

    found = motor_filter(tau, acceleration).corrections

    assert found == pytest.approx(tuple(gain), rel=1e-6)


def motor_filter(told: float, acceleration: float = 10.0, gain: float = 20.0) -> MotorKalman:
    return MotorKalman(
        gain=gain,
        time_constant=told,
        acceleration=acceleration,
        quantum=STEP,
        sample_time=T,
        voltage=lambda t: np.where(t >= 1.0 - 1e-9, 1.0, 0.0),
    )


def test_a_filter_that_is_told_the_truth_lags_behind_nothing() -> None:
    since = np.maximum(TIMES - 1.0, 0)
    speed = 20 * -np.expm1(-since / 0.1)
    position = 20 * (since + 0.1 * np.expm1(-since / 0.1))

    # The equations are the same: what is left is rounding.
    np.testing.assert_allclose(motor_filter(0.1)(position, TIMES), speed, rtol=0, atol=1e-10)


def test_both_are_speed_estimates_that_treat_signals_apart() -> None:
    x = np.stack([path(), 2 * path()[::-1]], axis=1)
    for estimate in (AlphaBeta(alpha=0.3, beta=0.05), motor_filter(0.1), Chain.parse("derivative")):
        assert isinstance(estimate, SpeedEstimate)
        together = estimate(x, TIMES)
        for column in (0, 1):
            np.testing.assert_allclose(together[:, column], estimate(x[:, column], TIMES), rtol=0, atol=1e-12)
        assert estimate(x[:0], TIMES[:0]).shape == (0, 2)


@pytest.mark.parametrize(("alpha", "beta"), [(0, 0.1), (0.1, 0), (-1, 1), (1.5, 1), (float("nan"), 0.1)])
def test_unstable_gains_are_refused(alpha: float, beta: float) -> None:
    with pytest.raises(UsageError, match="isn't stable"):
        AlphaBeta(alpha=alpha, beta=beta)


def test_settings_that_are_none_are_refused_by_name() -> None:
    with pytest.raises(UsageError, match="time constant of a Kalman filter is 0 s"):
        motor_filter(0.0)
    with pytest.raises(UsageError, match="random acceleration"):
        AlphaBeta.kalman(-1, STEP, T)
    with pytest.raises(UsageError, match="time constant of an α-β filter"):
        AlphaBeta.critically_damped(0, T)

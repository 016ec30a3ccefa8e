"""A lag in place of a delay: against the closed form, and with friction against the lag sampled finely."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.models import lag
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.lag import behind_lag, lag_errors
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset, prbs

GAIN, TAU, LAG, COULOMB = 20.0, 0.1, 0.002, 0.3  # rad/(s·V), s, s, V
STEP, SAMPLES = 0.002, 1000


def recorded(u: np.ndarray) -> Dataset:
    return dataset(seed=1, u=u, samples=SAMPLES, sample_time=STEP, y=np.zeros(SAMPLES))


def test_a_step_behind_a_lag_is_that_of_two_poles() -> None:
    """τ e^(-t/τ) and ℓ e^(-t/ℓ), from ten lags on, when all of the impulses that stand for the lag have acted.

    They lack half a percent of its second moment, 2 ℓ²: 0.0045 (ℓ/τ)² = 2e-6 of the whole.
    """
    u = np.where(np.arange(SAMPLES) < 100, 0.0, 2.0)
    theta = np.array([GAIN, TAU, 0.0, 3 * STEP, 0.0, 0.0])  # gain, τ, offset, delay, start
    late = replace(behind_lag(recorded(u), LAG), kind="speed", output_unit="rad/s", quantum=None)

    found = STRUCTURES["first_order"].predict(theta[:5], late).y

    since = np.maximum(STEP * (np.arange(SAMPLES) - 100) - (3 * STEP - LAG), 0.0)
    exact = 2.0 * GAIN * (1.0 - (TAU * np.exp(-since / TAU) - LAG * np.exp(-since / LAG)) / (TAU - LAG))
    settled = since > 10 * LAG
    assert settled.sum() > 800
    np.testing.assert_allclose(found[settled], exact[settled], atol=2e-6 * 2.0 * GAIN)
    # A pure delay in its place is off by (ℓ/τ)²/2 of the whole, less what has died away.
    plain = replace(recorded(u), kind="speed", output_unit="rad/s", quantum=None)
    off = STRUCTURES["first_order"].predict(theta[:5], plain).y - exact
    assert np.abs(off[settled]).max() > 1e-4 * 2.0 * GAIN


def test_with_friction_it_is_what_a_finely_sampled_lag_does() -> None:
    """The lag's exact answer to the input, held over a two-hundredth of it, which comes half of that late on average."""
    data = recorded(prbs(SAMPLES, 20, np.random.default_rng(3)))
    structure, theta = STRUCTURES["first_order_coulomb"], np.array([GAIN, TAU, COULOMB, 0.0, LAG, 0.0, 0.0])
    fine = LAG / 200
    times = fine * np.arange(round(SAMPLES * STEP / fine))
    held = np.concatenate([[0.0], data.u])[np.floor(times / STEP + 1e-6).astype(int) + 1]
    kept = np.exp(-fine / LAG)
    lagging = np.empty(len(times))
    value = 0.0
    for n, volts in enumerate(held):
        lagging[n] = value
        value = volts + (value - volts) * kept
    exact = replace(data, t_input=times - LAG - 0.5 * fine, u=lagging)

    found = lag_errors(structure, theta, data, LAG).sum(axis=1)

    expected = structure.predict(theta, exact).y - structure.predict(theta, data).y
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(found, expected, atol=0.05 * np.abs(expected).max())


def test_half_a_lag_follows_from_its_two_parts() -> None:
    data = recorded(prbs(SAMPLES, 20, np.random.default_rng(3)))
    structure, theta = STRUCTURES["first_order_coulomb"], np.array([GAIN, TAU, COULOMB, 0.0, LAG, 0.0, 0.0])

    linear, square = lag_errors(structure, theta, data, LAG).T

    half = structure.predict(theta, behind_lag(data, 0.5 * LAG)).y - structure.predict(theta, data).y
    np.testing.assert_allclose(0.5 * linear + 0.25 * square, half, atol=1e-12)


def test_a_lag_that_leads_beyond_what_any_motor_does_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A difference of two infinite outputs is no number, and a warning of NumPy's would reach the terminal."""
    data = dataset(seed=1, samples=50)
    monkeypatch.setattr(lag, "simulate_output", lambda *_: np.full(50, np.inf))

    assert not lag.lag_errors(STRUCTURES["first_order"], np.zeros(6), data, 0.01).any()

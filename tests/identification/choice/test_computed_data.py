"""Records that somebody computed: the parameters to many digits, and no friction or random torque found in rounding errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import servobench as sb
from tests.datasets import dataset

GAIN, TIME_CONSTANT, STEP = 20.0, 0.1, 0.002  # rad/(s·V), s, s


def computed(levels: tuple[float, float], noise: float = 0.0) -> sb.Result:
    """The result for the exact response of K/(τ s + 1) to a square wave, with noise [rad/s] added."""
    t = np.arange(2000) * STEP
    u = np.where(t % 1.0 < 0.5, *levels)
    speed, decay = np.zeros(len(t)), np.exp(-STEP / TIME_CONSTANT)
    for k in range(len(t) - 1):
        speed[k + 1] = decay * speed[k] + (1 - decay) * GAIN * u[k]
    speed += noise * np.random.default_rng(0).standard_normal(len(t))
    return sb.identify(t=t, u=u, y=speed, input_unit="V", output_unit="rad/s", chain="none")


@pytest.mark.parametrize("levels", [(2.0, 4.0), (-3.0, 3.0)])
def test_what_was_computed_is_known_to_many_digits(levels: tuple[float, float]) -> None:
    result = computed(levels)

    assert result["gain"].value == pytest.approx(GAIN, rel=1e-9)
    assert result["time_constant"].value == pytest.approx(TIME_CONSTANT, rel=1e-9)
    assert result["gain"].interval[0] < GAIN < result["gain"].interval[1]
    codes = {finding.code for finding in result.findings}
    assert "output-computed" in codes
    assert not codes & {"friction-found", "friction-possible", "disturbance-found", "residual-coloured"}


def test_a_little_noise_makes_it_a_measurement() -> None:
    result = computed((-3.0, 3.0), noise=1e-5)  # of 120 rad/s; the limit is a hundredth of that

    assert "output-computed" not in {finding.code for finding in result.findings}
    assert result["gain"].sd > computed((-3.0, 3.0))["gain"].sd


def test_the_steps_of_an_encoder_on_a_long_way_are_no_rounding_of_arithmetic() -> None:
    """An exact motor without friction, θ = K ∫u - τ ω, at levels of one sign; a count is 2e-9 of the whole way."""
    u = np.repeat(np.random.default_rng(2).uniform(1.0, 3.0, 20), 100)
    decay = np.exp(-STEP / TIME_CONSTANT)
    speed = lfilter([0.0, GAIN * (1 - decay)], [1.0, -decay], u)
    exact = GAIN * STEP * np.concatenate([[0.0], np.cumsum(u[:-1])]) - TIME_CONSTANT * speed
    count = 2e-9 * np.ptp(exact)
    t = STEP * np.arange(len(u))
    computed_data = replace(
        dataset(seed=0, samples=2, y=np.zeros(2)), t_input=t, u=u, t_output=t, y=exact, quantum=None
    )
    counted = replace(computed_data, y=(np.floor(exact / count) + 0.5) * count, quantum=count)
    codes = [{finding.code for finding in sb.identify(data).findings} for data in (computed_data, counted)]

    assert "output-computed" in codes[0]
    assert "output-computed" not in codes[1]


def test_as_many_values_as_parameters_are_no_proof_of_a_computer() -> None:
    """A rest of two seconds and four rows of a start: gain, time constant, delay and offset explain any of them."""
    u, y = np.where(np.arange(204) < 200, 0.0, 12.0), np.zeros(204)
    y[201:] = 0.687, 2.906, 4.732
    result = sb.identify(t=0.01 * np.arange(204), u=u, y=y, input_unit="V", output_unit="rad/s")

    assert "output-computed" not in {finding.code for finding in result.findings}
    low, high = result["gain"].interval
    assert high - low > 0.2 * result["gain"].value

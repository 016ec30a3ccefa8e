"""A motor that turns against its input is told, where the sign of its gain is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.trust.doubts.base import DOUBTS
from tests.report.makers import fit_of


@pytest.mark.parametrize(("gain", "sd", "told"), [(-2.0, 0.5, True), (-2.0, 1.5, False), (2.0, 0.5, False)])
def test_only_a_sign_that_is_known_is_reported(gain: float, sd: float, told: bool) -> None:
    fit = fit_of((gain, 0.1, 0.3, 0.002), np.diag([sd**2, 1e-6, 1e-4, 1e-8]))

    assert [each.code for each in DOUBTS["sense"].about_fit(fit)] == ["sign-negative"] * told


def _turned(u: NDArray[np.float64], driven: NDArray[np.float64], output: str = "y:rad/s") -> Result:
    """What is said of a motor of 100 ms that turns one way, driven by something else than the input says [rad/s]."""
    speed = signal.lfilter([0.0, -np.expm1(-0.1)], [1.0, -np.exp(-0.1)], driven)
    noise = 0.05 * np.random.default_rng(2).standard_normal(len(u))
    return identify({"u": u, "y": speed + noise}, input="u:%", output=output, sample_time=0.01)


def test_an_input_that_is_largest_at_rest_is_no_contradiction() -> None:
    """An active-low duty: 100 % stops the motor."""
    u = np.repeat(np.random.default_rng(1).uniform(20.0, 90.0, 12), 50)
    found = {each.code for each in _turned(u, 0.6 * (100.0 - u)).findings}

    assert "sign-negative" in found
    assert "gain-against-motion" not in found


def test_a_speed_that_falls_while_its_input_climbs_is_one() -> None:
    """A ramp under which the supply breaks down from the middle on."""
    u = np.linspace(20.0, 90.0, 400)
    found = {each.code for each in _turned(u, np.where(u < 45.0, 0.9 * u, 40.5 - 0.3 * (u - 45.0))).findings}

    assert "gain-against-motion" in found


def test_small_steps_about_an_input_that_is_not_in_the_file_matter() -> None:
    u = np.repeat(np.array([0.5, -0.5, 0.3, -0.3, 0.5, -0.3, 0.3, -0.5]), 60)
    found = {each.code for each in _turned(u, 10.0 * (4.0 + u)).findings}

    assert "input-hardly-matters" not in found

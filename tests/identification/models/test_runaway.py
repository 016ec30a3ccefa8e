"""Parameters under which nothing holds a motor back end in an infinite prediction, and not in an endless one."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.records import through_chain
from tests.datasets import dataset


def test_a_motor_that_runs_away_is_infinitely_far_off() -> None:
    structure = STRUCTURES["first_order_asymmetric"]
    data = dataset(seed=1)
    value = {parameter.name: 0.0 for parameter in structure.parameters}
    # dω/dt = (-1 - K u_a) ω/τ = 9999 ω/τ: e^(9999 t/τ) leaves the range of a float within a second.
    value |= {"gain": 20.0, "time_constant": 0.1, "drag_asymmetry": -500.0}
    nuisance = np.zeros(len(structure.nuisance(data)))

    prediction = structure.predict(np.append(list(value.values()), nuisance), data)

    assert np.isinf(prediction.y[-1])
    assert not np.isnan(prediction.y).any()


def test_a_pendulum_that_swings_thousands_of_times_between_samples_is_infinitely_far_off() -> None:
    """At √(K u_gs/τ) = 1e6 rad/s and 2 ms a sample each would take thousands of steps: no motor, and seconds for a prediction."""
    structure = STRUCTURES["first_order_coulomb_gravity"]
    data = dataset(seed=1, samples=500)
    value = {parameter.name: 0.0 for parameter in structure.parameters}
    value |= {
        "gain": 8e6,
        "time_constant": 4e-4,
        "gravity_voltage_sine": 78.0,
        "gravity_voltage_cosine": 39.0,
    }

    prediction = structure.predict(np.array([*value.values(), 2.4, 1e5]), data)

    assert np.isfinite(prediction.y[10])
    assert np.isinf(prediction.y[-1])


@pytest.mark.parametrize(
    ("samples", "swings", "finite"), [(300, 0.3, True), (5000, 0.3, False), (5000, 0.03, True)]
)
def test_a_pendulum_that_swings_from_sample_to_sample_is_followed_for_a_short_record(
    samples: int, swings: float, finite: bool
) -> None:
    """At 0.3 swings a sample it takes about 19 steps in each: a coarse short record may, one of 5,000 samples is no motor's."""
    structure = STRUCTURES["first_order_coulomb_gravity"]
    data = dataset(seed=1, samples=samples)
    omega, tau, gain = 2 * np.pi * swings / data.sample_time, 1.0, 20.0
    value = {parameter.name: 0.0 for parameter in structure.parameters}
    value |= {"gain": gain, "time_constant": tau, "gravity_voltage_sine": omega**2 * tau / gain}

    prediction = structure.predict(np.array([*value.values(), 1.0, 0.0]), data)

    assert np.isfinite(prediction.y[-1]) == finite


def test_sensitivities_beyond_all_numbers_pass_a_chain_without_a_warning() -> None:
    """A search takes such a place for infinitely bad; a warning of NumPy's would reach whoever reads the terminal."""
    data = dataset(seed=1, samples=100, chain="derivative")
    count = len(data.t_output)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        passed = through_chain(
            np.zeros(count), np.full((count, 2), np.inf), np.zeros(len(data.start_states)), data
        )

    assert not np.isfinite(passed.jacobian).all()

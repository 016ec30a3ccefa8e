"""Truth: textbook step responses, closed forms of rise time and bandwidth, and SciPy's simulation."""

import math

import numpy as np
import pytest
from scipy.signal import lti

from servobench.systems.responses import bandwidth, rise_time, step_response
from servobench.systems.transfer_function import TransferFunction


def system(
    numerator: tuple[float, ...], denominator: tuple[float, ...], delay: float = 0.0
) -> TransferFunction:
    return TransferFunction(numerator=numerator, denominator=denominator, delay=delay)


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ((3.0,), (1.0, 2.0, 10.0, 4.0)),
        ((1.0, 5.0), (1.0, 6.0, 11.0, 6.0)),  # distinct poles: a sum of modes
        ((1.0,), (1.0, 3.0, 3.0, 1.0)),  # a threefold one: the matrix exponential
        ((1.0,), (1.0, 2.0005, 1.0005)),  # two that are near to each other
        ((1.0,), (1.0, 3.0, 0.0)),
    ],
)
def test_step_responses_are_those_of_scipy(
    numerator: tuple[float, ...], denominator: tuple[float, ...]
) -> None:
    t = np.linspace(0, 8, 81)

    response = step_response(system(numerator, denominator), t)

    _, expected = lti(list(numerator), list(denominator)).step(T=t)
    np.testing.assert_allclose(response, expected, atol=1e-10)


def test_the_rise_time_of_a_first_order_lag_is_tau_ln_9_and_a_delay_doesn_t_change_it() -> None:
    for delay in (0.0, 0.3):
        assert rise_time(system((20.0,), (0.1, 1.0), delay)) == pytest.approx(0.1 * math.log(9), rel=1e-12)


def test_the_rise_time_of_an_oscillation_without_damping_to_speak_of_is_that_of_a_cosine() -> None:
    # 1 - cos(ωt) e^(-σt): with σ = 1e-6 ω that is the cosine to 1e-6; acos(1 - y)/ω
    omega = 5.0
    expected = (math.acos(0.1) - math.acos(0.9)) / omega

    found = rise_time(system((omega**2,), (1.0, 2e-6 * omega, omega**2)))

    assert found == pytest.approx(expected, rel=1e-5)


def test_the_rise_time_of_a_double_pole_solves_its_equation() -> None:
    found = rise_time(system((1.0,), (1.0, 2.0, 1.0)))

    # (1 + t) e^(-t) = 0.9 at 0.531812, and 0.1 at 3.889720
    assert found == pytest.approx(3.889720 - 0.531812, abs=2e-6)


def test_the_bandwidth_of_a_first_order_lag_is_its_pole_and_of_a_double_pole_less() -> None:
    assert bandwidth(system((20.0,), (0.1, 1.0))) == pytest.approx(10.0, rel=1e-12)
    # (1 + ω²)² = 2
    assert bandwidth(system((1.0,), (1.0, 2.0, 1.0))) == pytest.approx(math.sqrt(math.sqrt(2) - 1), rel=1e-12)


def test_what_a_system_doesn_t_have_is_not_a_number() -> None:
    assert math.isnan(bandwidth(system((1.0,), (1.0, 0.0))))
    assert math.isnan(rise_time(system((1.0,), (1.0, 0.0))))
    assert math.isnan(rise_time(system((1.0, 0.0), (1.0, 1.0))))
    assert bandwidth(system((2.0,), (4.0,))) == math.inf
    assert rise_time(system((2.0,), (4.0,))) == 0.0

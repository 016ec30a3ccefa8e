"""A transfer function against the algebra of first and second order systems, and against SciPy."""

import cmath
import math

import numpy as np
import pytest
import scipy.signal

from servobench.core.errors import UsageError
from servobench.systems.transfer_function import TransferFunction


def test_a_first_order_lag_at_its_corner_has_gain_over_root_two_and_45_degrees() -> None:
    lag = TransferFunction(numerator=(20.0,), denominator=(0.1, 1.0))

    (response,) = lag.frequency_response(np.array([10.0]))

    assert abs(response) == pytest.approx(20 / math.sqrt(2), rel=1e-14)
    assert cmath.phase(response) == pytest.approx(-math.pi / 4, rel=1e-14)


def test_a_delay_turns_the_phase_and_leaves_the_gain() -> None:
    prompt = TransferFunction(numerator=(2.0,), denominator=(0.1, 1.0))
    late = TransferFunction(numerator=(2.0,), denominator=(0.1, 1.0), delay=0.003)
    omega = np.array([1.0, 10.0, 100.0])

    ratio = late.frequency_response(omega) / prompt.frequency_response(omega)

    np.testing.assert_allclose(np.abs(ratio), 1, rtol=1e-14)
    np.testing.assert_allclose(np.angle(ratio), -0.003 * omega, rtol=1e-12)


def test_the_frequency_response_is_that_of_scipy() -> None:
    numerator, denominator, omega = (1.0, -2.0), (2.0, 0.0, 3.0, 7.0), np.logspace(-2, 2, 50)

    expected = scipy.signal.freqs(numerator, denominator, omega)[1]

    response = TransferFunction(numerator=numerator, denominator=denominator).frequency_response(omega)
    np.testing.assert_allclose(response, expected, rtol=1e-12)


def test_poles_stand_slowest_first_and_zeros_are_the_numerators_roots() -> None:
    # (s - 3) / (s (s + 2) (s + 500))
    system = TransferFunction(numerator=(1.0, -3.0), denominator=(1.0, 502.0, 1000.0, 0.0))

    np.testing.assert_allclose(system.poles, [0, -2, -500], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(system.zeros, [3], rtol=1e-14)


@pytest.mark.parametrize(
    ("numerator", "denominator", "delay", "expected"),
    [
        ((23.8,), (0.1, 1.0), 0.0, "(23.8) / (0.1 s + 1)"),
        ((1.0, -2.0), (1.0, 0.0, -3.0, 0.0), 0.002, "(s - 2) / (s^3 - 3 s) · e^(-0.002 s)"),
        ((-1.0, 0.0), (-2.0,), 0.0, "(-s) / (-2)"),
        ((0.0,), (1.0,), 0.0, "(0) / (1)"),
    ],
)
def test_it_is_written_as_on_paper(numerator: tuple, denominator: tuple, delay: float, expected: str) -> None:
    assert str(TransferFunction(numerator=numerator, denominator=denominator, delay=delay)) == expected


@pytest.mark.parametrize(
    ("numerator", "denominator", "delay"),
    [
        ((), (1.0,), 0),
        ((1.0,), (), 0),
        ((1.0,), (0.0, 1.0), 0),
        ((math.nan,), (1.0,), 0),
        ((1.0,), (1.0,), math.inf),
    ],
)
def test_coefficients_that_make_no_system_are_refused(
    numerator: tuple, denominator: tuple, delay: float
) -> None:
    with pytest.raises(UsageError, match=r"no transfer function: .* expected finite coefficients"):
        TransferFunction(numerator=numerator, denominator=denominator, delay=delay)

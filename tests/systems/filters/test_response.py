"""Responses, lags and attenuations, against SciPy's filters and complex arithmetic."""

import cmath
import math

import numpy as np
import pytest
from scipy.signal import freqz, group_delay, lfilter

from servobench.core.errors import UsageError
from servobench.recordings.measurement.base import Chain
from servobench.systems.filters.attenuation import attenuation
from servobench.systems.filters.response import frequency_response, impulse_response, lag
from tests.systems.filters.test_quantisation import coefficients

T = 0.002


@pytest.mark.parametrize("how", ["euler", "zoh", "tustin"])
def test_the_impulse_response_is_that_of_the_difference_equation(how: str) -> None:
    b, a = coefficients(50, T, how)
    one = np.zeros(400)
    one[0] = 1 / T

    g = impulse_response(Chain.parse(f"derivative | lowpass 50 rad/s {how}"), T)

    expected = lfilter(b, a, np.diff(one, prepend=0.0))[: len(g)]
    np.testing.assert_allclose(g[:400], expected[:400], rtol=0, atol=1e-11 / T)


@pytest.mark.parametrize("how", ["euler", "zoh", "tustin"])
def test_the_frequency_response_is_scipys(how: str) -> None:
    omega = np.array([5.0, 50.0, 500.0, 1500.0])

    found = frequency_response(Chain.parse(f"lowpass 50 rad/s {how}"), omega, T)

    np.testing.assert_allclose(found, freqz(*coefficients(50, T, how), worN=omega * T)[1], rtol=1e-9)


@pytest.mark.parametrize("how", ["euler", "zoh", "tustin"])
@pytest.mark.parametrize("cutoff", [10, 50, 200])
def test_the_lag_is_the_group_delay_at_zero_and_half_a_sample_for_the_difference(
    how: str, cutoff: float
) -> None:
    delay = group_delay(coefficients(cutoff, T, how), w=[1e-5])[1][0] * T

    # The group delay at a small frequency is off by the frequency's square.
    assert lag(Chain.parse(f"derivative | lowpass {cutoff} rad/s {how}"), T) == pytest.approx(
        delay + T / 2, rel=1e-6
    )


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("derivative", T / 2),
        ("tachometer 40 ms", 0.02),
        ("least_squares 40 ms", 0.02),
        ("derivative | average 40 ms", 0.021),
    ],
)
def test_windows_lag_by_their_half(text: str, expected: float) -> None:
    assert lag(Chain.parse(text), T) == pytest.approx(expected, rel=1e-9)


def test_a_parabola_comes_out_late_by_the_lag() -> None:
    """Another way to the lag: the speed of a steady acceleration, once the start is forgotten."""
    t = T * np.arange(2000)
    chain = Chain.parse("derivative | lowpass 50 rad/s euler | average 10 ms")

    assert t[-1] - chain(0.5 * t**2, t)[-1] == pytest.approx(lag(chain, T), rel=1e-9)


@pytest.mark.parametrize("text", ["lowpass 50 rad/s", "derivative | scale 2", "scale -1 | derivative"])
def test_what_is_no_speed_of_the_position_has_no_lag(text: str) -> None:
    with pytest.raises(UsageError, match="expected an estimate of the speed"):
        lag(Chain.parse(text), T)


def test_a_filter_that_never_forgets_is_refused() -> None:
    with pytest.raises(UsageError, match="expected a response that dies out"):
        impulse_response(Chain.parse("derivative | lowpass 1e-9 rad/s"), T)


@pytest.mark.parametrize("omega", [0.0, 5.0, 50.0, 500.0])
def test_attenuation_is_the_size_of_the_transfer_function(omega: float) -> None:
    g = 50 / (1j * omega + 50)

    found = attenuation(50, omega)

    assert (found.amplitude, found.phase) == pytest.approx((abs(g), cmath.phase(g)), abs=1e-15)
    assert found.power == pytest.approx(abs(g) ** 2)
    assert found.decibels == pytest.approx(20 * math.log10(abs(g)), abs=1e-12)


def test_at_the_cutoff_half_of_the_power_and_70_7_percent_of_the_amplitude_are_left() -> None:
    found = attenuation(50, 50)

    assert found.power == pytest.approx(0.5)
    assert found.amplitude == pytest.approx(1 / math.sqrt(2))
    assert found.decibels == pytest.approx(-3.0103, abs=5e-5)
    assert math.degrees(found.phase) == pytest.approx(-45)

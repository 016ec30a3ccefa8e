"""Probabilities, beside SciPy's."""

import math
import statistics

import numpy as np
import pytest
from scipy import special

from servobench.core.probability import chi_square_above, log_normal_below, normal_below, normal_quantile

EPS = np.finfo(float).eps
NUMBERS = [-1e4, -200.0, -37.0, -36.0, -35.9, -20.0, -6.0, -1.0, -0.1, 0.0, 0.1, 1.0, 3.0, 8.0, 20.0, 100.0]


@pytest.mark.parametrize("x", NUMBERS)
def test_the_normal_distribution(x: float) -> None:
    # The exponent x²/2 is rounded to half a digit of itself, which is a relative error of the probability.
    rounding = 8 * EPS * max(x**2, 1.0)
    assert normal_below(x) == pytest.approx(special.ndtr(x), rel=rounding, abs=1e-307)
    assert log_normal_below(x) == pytest.approx(special.log_ndtr(x), rel=1e-12)


@pytest.mark.parametrize("probability", [1e-300, 1e-20, 0.025, 0.3, 0.5, 0.7, 0.975, 1 - 1e-12])
def test_a_normal_quantile(probability: float) -> None:
    assert normal_quantile(probability) == pytest.approx(special.ndtri(probability), rel=1e-13, abs=1e-16)


@pytest.mark.parametrize("probability", [0.0, 1.0, -0.1])
def test_there_is_no_quantile_of_what_is_no_probability(probability: float) -> None:
    with pytest.raises(statistics.StatisticsError):
        normal_quantile(probability)


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 5, 8, 21])
@pytest.mark.parametrize("value", [-1.0, 0.0, 1e-9, 0.3, 2.0, 9.0, 60.0, 1000.0])
def test_chi_square(value: float, freedom: int) -> None:
    expected = special.chdtrc(freedom, max(value, 0.0))
    assert chi_square_above(value, freedom) == pytest.approx(expected, rel=16 * EPS * max(value, 16.0))


def test_nothing_is_left_far_out() -> None:
    assert [chi_square_above(math.inf, freedom) for freedom in (1, 2, 3)] == [0.0, 0.0, 0.0]
    assert chi_square_above(1e5, 3) == 0.0
    assert normal_below(-50.0) == 0.0
    assert math.isfinite(log_normal_below(-1e100))

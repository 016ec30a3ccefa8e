"""The zero between two ends, beside SciPy's."""

import math
import sys
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import brentq

from servobench.core.crossing import crossing


@pytest.mark.parametrize(
    ("function", "low", "high", "zero"),
    [
        (lambda x: x**2 - 2, 0.0, 2.0, math.sqrt(2)),
        (lambda x: math.exp(x) - 1e-3, -50.0, 50.0, math.log(1e-3)),
        (lambda x: math.atan(x) - 1.2, 0.0, 400.0, math.tan(1.2)),
        (lambda x: 3e-9 - x, 0.0, 1e6, 3e-9),
        (lambda x: (x - 2) ** 3, -7.0, 5.0, 2.0),
        (lambda x: x, -1.0, 0.0, 0.0),
        (lambda x: x, 0.0, 1.0, 0.0),
        (lambda x: -1.0 if x < 1 / 3 else 1.0, 0.0, 1.0, 1 / 3),
        (lambda x: x - 1, 5.0, 0.5, 1.0),
    ],
)
def test_a_zero_is_found_to_the_last_digits(
    function: Callable[[float], float], low: float, high: float, zero: float
) -> None:
    found = crossing(function, low, high)

    # Half of the digits of a triple zero are lost in its cube, all others keep a few units in the last place.
    assert found == pytest.approx(zero, rel=16 * sys.float_info.epsilon, abs=sys.float_info.min)


def test_polynomials_cross_zero_where_scipy_says() -> None:
    rng = np.random.default_rng(20)
    compared = 0
    for _ in range(500):
        polynomial = np.polynomial.Polynomial(rng.normal(size=6))
        low, high = float(rng.uniform(-3, 0)), float(rng.uniform(0, 3))
        if polynomial(low) * polynomial(high) > 0:
            continue
        compared += 1
        roots = polynomial.roots()
        real = roots[abs(roots.imag) < 1e-9].real
        found = crossing(polynomial, low, high)
        assert np.min(np.abs(real - found)) < 1e-9
        if np.sum((real > low) & (real < high)) == 1:
            assert found == pytest.approx(brentq(polynomial, low, high, xtol=1e-14), rel=1e-9, abs=1e-12)
    assert compared > 150


def test_a_smooth_function_takes_about_ten_evaluations() -> None:
    seen: list[float] = []

    def function(x: float) -> float:
        seen.append(x)
        return math.cos(x) - x

    crossing(function, 0.0, 1.0)

    # 52 halvings would be needed for as many digits.
    assert len(seen) <= 12


def test_ends_of_the_same_sign_are_refused() -> None:
    with pytest.raises(ValueError, match=r"2 at 1 and 5 at 2: a crossing was expected"):
        crossing(lambda x: x**2 + 1, 1.0, 2.0)

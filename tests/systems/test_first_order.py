"""Values computed from a first-order motor's parameters have an interval if the parameters do."""

import math

import pytest

from servobench.core.estimate import Estimate
from servobench.core.rounding import TWO_SIDED
from servobench.systems.first_order import inverse, ratio, scale_estimate


def estimate(value: float, low: float, high: float) -> Estimate:
    sd = (high - low) / (2 * TWO_SIDED)
    return Estimate(value=value, sd=sd, interval=(low, high), level=0.95, unit="rad/(s·V)")


@pytest.mark.parametrize(("low", "high"), [(-1.0, 3.0), (0.0, 2.0), (-2.0, 0.0)])
def test_the_inverse_of_what_may_be_zero_has_no_interval(low: float, high: float) -> None:
    assert all(math.isnan(end) for end in inverse(estimate(1.0, low, high), "V·s/rad").interval)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_inverse_and_a_multiple_have_the_ends_of_the_interval_in_order(sign: float) -> None:
    given = estimate(sign * 2.0, *sorted((sign * 1.0, sign * 4.0)))

    assert inverse(given, "V·s/rad").interval == tuple(sorted((sign * 0.25, sign * 1.0)))
    flipped = scale_estimate(given, -3.0, "rpm/V")
    assert flipped.interval == tuple(sorted((-sign * 3.0, -sign * 12.0)))
    assert flipped.sd == pytest.approx(3 * given.sd)


def test_errors_that_go_together_leave_the_ratio_as_it_is() -> None:
    """x and y that are off by the same share: x/y is known, whatever either is."""
    x, y = estimate(20.0, 16.0, 24.0), estimate(10.0, 8.0, 12.0)

    alone, together = ratio(x, y, 0.0, "1"), ratio(x, y, x.sd * y.sd, "1")

    assert alone.value == together.value == 2.0
    assert alone.sd == pytest.approx(2.0 * math.hypot(x.sd / 20, y.sd / 10))
    assert together.sd == pytest.approx(0.0, abs=1e-7)

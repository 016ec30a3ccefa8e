"""Minima that explain the data nearly as well: what a mixture of them has more than one alone, by algebra."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.delay_prior import DelayPrior
from servobench.identification.estimators.least_squares import Minimum
from servobench.identification.estimators.other_minima import other_minima
from servobench.identification.models.level import OneLevel

COVARIANCE = np.diag([0.01, 0.04])


def found_beside(
    *others: tuple[tuple[float, float], float],
    cost: float = 2.0,
    samples: int = 500,
    prior: DelayPrior | None = None,
) -> Contribution | None:
    """The contribution of other ends to a place at (1, 2)."""
    place = Minimum(theta=np.array([1.0, 2.0]), predictions=(), cost=cost, converged=True, status="")
    ends = [(np.array(theta), each) for theta, each in others]
    return other_minima(place, ends, COVARIANCE, samples, prior=prior)


def test_of_two_minima_that_are_as_good_the_variance_is_that_of_two_points() -> None:
    found = found_beside(((4.0, 0.0), 2.0))

    # Half the probability each, of which the first is what is stated: its mean square distance is half the square of the way.
    assert found is not None
    way = np.array([3.0, -2.0])
    assert found.covariance == pytest.approx(0.5 * np.outer(way, way))


def test_the_odds_are_those_of_normal_residuals() -> None:
    found = found_beside(((4.0, 2.0), 2.0 * 1.01), samples=400)

    odds = 1.01 ** (-200)
    assert found is not None
    assert found.covariance[0, 0] == pytest.approx(9.0 * odds / (1 + odds))


def test_a_minimum_that_several_starts_led_to_counts_once() -> None:
    once = found_beside(((4.0, 0.0), 2.0))
    twice = found_beside(((4.0, 0.0), 2.0), ((4.05, 0.1), 2.0))

    assert once is not None
    assert twice is not None
    assert np.array_equal(once.covariance, twice.covariance)


@pytest.mark.parametrize(
    ("other", "cost"),
    [(((4.0, 0.0), 2.2), 2.0), (((1.05, 2.1), 2.0), 2.0), (((4.0, 0.0), 1.0), 0.0)],
    ids=["far less likely", "the same one", "nothing left over"],
)
def test_what_is_no_other_minimum_adds_nothing(other: tuple[tuple[float, float], float], cost: float) -> None:
    assert found_beside(other, cost=cost) is None


def test_a_delay_that_no_loop_has_makes_a_minimum_unlikely() -> None:
    usual = DelayPrior(at=1, middle=2.0, scale=0.01)

    assert found_beside(((4.0, 0.0), 2.0), prior=usual) is None
    assert found_beside(((4.0, 2.0), 2.0), prior=usual) is not None


def test_gain_and_time_constant_that_are_both_many_times_larger_leave_their_quotient() -> None:
    """(1, 2) and (1000, 2000) differ by ln 1000 of each, and not at all in K/τ."""
    place = Minimum(theta=np.array([1.0, 2.0]), predictions=(), cost=2.0, converged=True, status="")

    found = other_minima(place, [(np.array([1000.0, 2000.0]), 2.0)], COVARIANCE, 500, (0, 1))

    assert found is not None
    quotient = np.array([1.0, -0.5])  # of relative changes
    assert quotient @ found.covariance @ quotient == pytest.approx(0.0, abs=1e-12)
    assert found.covariance[0, 0] == pytest.approx(0.5 * np.log(1000.0) ** 2)


@pytest.mark.parametrize("gain", [3.0, -0.5])
def test_under_one_level_the_speed_changes_by_what_it_differs(gain: float) -> None:
    """Gain 1 and friction 2 V under 10 V make 8 rad/s; the other minimum makes 9, with whatever gain."""
    place = Minimum(theta=np.array([1.0, 2.0]), predictions=(), cost=2.0, converged=True, status="")
    other = np.array([gain, 10.0 - 9.0 / gain])

    found = other_minima(
        place,
        [(other, 2.0)],
        COVARIANCE,
        500,
        scales=(0,),
        one_level=OneLevel(level=10.0, gain=0, friction=1),
    )

    assert found is not None
    slope = np.array([10.0 - 2.0, -1.0])  # of the speed K (u - u_c) by K and u_c
    assert slope @ found.covariance @ slope == pytest.approx(0.5 * (9.0 - 8.0) ** 2)

"""Profile intervals near a bound: against the parabola's own answer, a brute-force profile, and the truth over many runs."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.estimators import near_bounds
from servobench.identification.estimators.least_squares import lowest, minimise
from servobench.identification.estimators.near_bounds import intervals_near_bounds
from servobench.identification.estimators.output_error import uncertainty
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

COULOMB = STRUCTURES["first_order_coulomb"]


def _answer(seed: int, coulomb_torque: float):  # type: ignore[no-untyped-def]
    data = [dataset(seed=seed, kind="prbs", samples=1500, truth=Truth(coulomb_torque=coulomb_torque))]
    minimum = lowest(COULOMB, data, COULOMB.guesses(data))
    return data, minimum, uncertainty(COULOMB, data, minimum)[1]


def test_far_from_a_bound_nothing_is_profiled() -> None:
    assert intervals_near_bounds(COULOMB, *_answer(1, 8e-4)) == {}


def test_an_end_is_where_a_brute_force_profile_reaches_the_same_rise() -> None:
    """With sd taken twenty times wider, the bound is near, and the cost on the way is anything but a parabola."""
    data, minimum, covariance = _answer(1, 8e-5)
    at = [p.name for p in COULOMB.parameters].index("coulomb_voltage")
    wide = covariance * (0.5 * minimum.theta[at]) ** 2 / covariance[at, at]
    low, high = intervals_near_bounds(COULOMB, data, minimum, wide)["coulomb_voltage"]
    assert 0.0 <= low < minimum.theta[at] < high

    def rise(value: float) -> float:
        theta, free = minimum.theta.copy(), np.ones(len(minimum.theta), dtype=bool)
        theta[at], free[at] = value, False
        return minimise(COULOMB, data, theta, free).cost - minimum.cost

    value = minimum.theta[at]
    # The wished rise is that of the parabola with the curvature that the plain covariance says.
    small = 0.05 * np.sqrt(covariance[at, at])
    curvature = (rise(value + small) + rise(value - small)) / small**2
    assert rise(high) == pytest.approx(0.5 * curvature * (1.959964**2) * wide[at, at], rel=0.25)


@pytest.mark.parametrize("coulomb_torque", [0.0, 2e-6])
def test_coulomb_voltage_near_zero_is_covered(coulomb_torque: float) -> None:
    """40 runs at 95 %: fewer than 34 is 1 case in 130 (binomial)."""
    covered = 0
    truth = coulomb_torque * Truth().resistance / Truth().motor_constant
    for seed in range(40):
        found = intervals_near_bounds(COULOMB, *_answer(seed, coulomb_torque))
        low, high = found.get("coulomb_voltage", (np.nan, np.nan))
        if np.isnan(low):
            _, minimum, covariance = _answer(seed, coulomb_torque)
            low, high = minimum.theta[2] + 1.96 * np.sqrt(covariance[2, 2]) * np.array([-1.0, 1.0])
        assert low >= 0.0
        covered += low <= truth <= high
    assert covered >= 34


def test_a_valley_is_followed_to_its_end() -> None:
    """Turning one way, friction and offset are one: any friction from none to all of the input explains the data as well."""
    data = [dataset(seed=1, kind="square", samples=2000, truth=Truth(coulomb_torque=2e-3))]
    minimum = lowest(COULOMB, data, COULOMB.guesses(data))
    covariance = uncertainty(COULOMB, data, minimum)[1]
    at = [p.name for p in COULOMB.parameters].index("coulomb_voltage")
    value = minimum.theta[at]
    # A standard deviation of the size of the friction: a fifth of its interval was too long a way for a search along one axis.
    wide = covariance * value**2 / covariance[at, at]

    low, high = intervals_near_bounds(COULOMB, data, minimum, wide)["coulomb_voltage"]

    assert low >= 0.0
    assert high > value + 1.9 * value


def test_intervals_are_searched_for_the_fit_that_is_kept_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """A choice between structures and a cross-validation make half a dozen fits here, of which the result has one."""
    searched: list[tuple[str, str]] = []
    interval = near_bounds._Profile.interval

    def counted(profile: near_bounds._Profile, lower: float, upper: float) -> tuple[float, float]:
        name = profile.structure.parameters[profile.at].name
        searched.append((STRUCTURES.name_of(profile.structure), name))
        return interval(profile, lower, upper)

    monkeypatch.setattr(near_bounds._Profile, "interval", counted)

    result = identify(dataset(seed=1, kind="prbs", samples=1500, truth=Truth(coulomb_torque=0.0)))

    assert result.validation is not None
    assert result.fit is not None
    assert "coulomb_voltage" in result.fit.intervals
    assert searched == [("first_order_coulomb", "coulomb_voltage")]


def test_an_interval_is_searched_for_once_it_is_read_and_by_itself() -> None:
    data, minimum, covariance = _answer(1, 0.0)
    covariance[np.diag_indices(len(covariance))] += 1.0  # each parameter may lie at its bound
    intervals = intervals_near_bounds(COULOMB, data, minimum, covariance)

    assert set(intervals) == {"time_constant", "coulomb_voltage", "delay"}  # the others have no bounds
    assert not intervals._ends

    one = intervals["coulomb_voltage"]

    assert intervals._ends == {"coulomb_voltage": one}
    assert intervals["coulomb_voltage"] is one

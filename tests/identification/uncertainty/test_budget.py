"""The budget of uncertainty: what adds up, and what never gets narrower."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.budget import Contribution, beyond
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.composition import MEASUREMENT, composition, parts_of
from servobench.identification.uncertainty.identifiability import ParameterStatus, State
from tests.datasets import dataset


def fitted() -> Fit:
    data = dataset(seed=1, samples=2500)
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])


def line(fit: Fit, name: str, sd: float, source: str = "play") -> Contribution:
    covariance = np.zeros_like(fit.covariance)
    at = fit.model.names.index(name)
    covariance[at, at] = sd**2
    return Contribution(source=source, covariance=covariance, reason="a test")


def test_a_line_adds_its_variance_and_widens_the_interval() -> None:
    fit = fitted()
    sd = 3.0 * fit["gain"].sd
    wider = fit.widen(line(fit, "gain", sd))

    assert wider["gain"].sd == pytest.approx(np.hypot(fit["gain"].sd, sd))
    low, high = wider["gain"].interval
    assert high - low == pytest.approx(2 * TWO_SIDED * wider["gain"].sd)
    assert wider["time_constant"] == fit["time_constant"]


def test_an_interval_that_is_uneven_keeps_its_shape_and_grows_on_both_sides() -> None:
    value = fitted()["coulomb_voltage"].value
    fit = replace(fitted(), intervals={"coulomb_voltage": (value - 0.003, value + 0.004)})
    low, high = fit.widen(line(fit, "coulomb_voltage", 0.004 / TWO_SIDED))["coulomb_voltage"].interval

    assert value - low == pytest.approx(0.005)  # 3, 4, 5
    assert high - value == pytest.approx(0.004 * np.sqrt(2))


def test_no_interval_goes_beyond_what_can_be() -> None:
    """A time constant is positive, and the shaft moved within a few samples of the step: that is the latest its delay ends."""
    u = np.where(np.arange(2500) < 250, 0.0, 3.0)
    data = dataset(seed=1, samples=2500, u=u)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])
    assert data.first_motion is not None
    wider = (
        fit.widen(line(fit, "delay", 10.0))
        .widen(line(fit, "time_constant", 10.0))
        .widen(line(fit, "gain", 1e3))
    )

    assert wider["time_constant"].interval[0] == 0.0
    assert wider["time_constant"].interval[1] > 10.0
    latest = data.first_motion.effect - data.first_motion.cause + 0.002
    assert wider["delay"].interval[1] == pytest.approx(latest)
    assert wider["gain"].interval[0] < 0.0


def test_the_shares_of_a_budget_add_up_to_the_whole_variance() -> None:
    fit = fitted()
    fit = fit.widen(line(fit, "gain", 0.02)).widen(line(fit, "gain", 0.01, "cogging"))
    lines = composition(fit)

    assert [each.source for each in lines] == [MEASUREMENT, "play", "cogging"]
    for name in fit.model.names:
        assert sum(each.shares.get(name, 0.0) for each in lines) == pytest.approx(
            1.0, abs=3e-4
        )  # parts below 1e-4 are left out
    half = np.sqrt(sum(each.half_widths.get("gain", 0.0) ** 2 for each in lines))
    assert half == pytest.approx(TWO_SIDED * fit["gain"].sd, rel=1e-4)


@pytest.mark.parametrize("cut", [1.0, 0.4])
def test_no_part_of_an_interval_is_larger_than_the_whole(cut: float) -> None:
    """A time constant had an interval of ±48 %, cut where the speed settles, of which the noise model was ±101 %."""
    fit = fitted()
    fit = fit.widen(line(fit, "gain", 0.04)).widen(line(fit, "gain", 0.03, "cogging"))
    value, half = fit["gain"].value, cut * TWO_SIDED * fit["gain"].sd
    whole = replace(fit["gain"], interval=(value - half, value + half))
    answer = ParameterStatus(name="gain", state=State.KNOWN, estimate=whole)

    parts = parts_of(composition(fit), answer)

    assert [each.source for _, each in parts][:2] == ["play", "cogging"]
    assert np.hypot.reduce([width for width, _ in parts]) == pytest.approx(100 * half / value, rel=1e-3)
    assert parts[0][0] == pytest.approx(4 / 3 * parts[1][0])


@pytest.mark.parametrize("seed", range(20))
def test_what_is_beyond_makes_no_direction_narrower_than_the_target(seed: int) -> None:
    """For any direction g: g'(already + beyond) g >= g' target g, and beyond alone is a covariance."""
    random = np.random.default_rng(seed)
    units = np.diag(10.0 ** random.uniform(-6, 3, 4))
    target, already = (
        units @ x @ x.T @ units for x in (random.standard_normal((4, 4)), random.standard_normal((4, 4)))
    )
    added = beyond(target, already)

    assert np.linalg.eigvalsh(np.linalg.inv(units) @ added @ np.linalg.inv(units)).min() > -1e-12
    for direction in random.standard_normal((50, 4)) @ np.linalg.inv(units):
        whole = direction @ (already + added) @ direction
        assert whole >= direction @ target @ direction - 1e-9 * whole


def test_what_is_within_adds_nothing() -> None:
    already = np.diag([4.0, 9.0])

    assert beyond(0.9 * already, already) == pytest.approx(np.zeros((2, 2)), abs=1e-12)


def test_a_combination_that_is_known_stays_known_beside_an_unknown_difference() -> None:
    """K (u - u_c) under one level: the variance of the sum stays that of the sum, however large that of each part."""
    apart, together = np.array([1.0, -1.0]), np.array([1.0, 1.0])
    target = 1e6 * np.outer(apart, apart) + 1e-4 * np.outer(together, together)
    added = beyond(target, np.zeros((2, 2)))

    assert together @ added @ together == pytest.approx(4e-4, rel=1e-6)


def test_a_line_that_is_taken_away_leaves_what_was_before() -> None:
    value = fitted()["coulomb_voltage"].value
    fit = replace(fitted(), intervals={"coulomb_voltage": (value - 0.003, value + 0.004)})
    back = fit.widen(line(fit, "coulomb_voltage", 0.004)).without("play")

    assert back.covariance == pytest.approx(fit.covariance, rel=1e-9)
    assert back["coulomb_voltage"].interval == pytest.approx(fit["coulomb_voltage"].interval, rel=1e-9)
    assert back.budget == ()

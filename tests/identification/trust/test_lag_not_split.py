"""A lag of which nobody can tell how much is the time constant and how much is a delay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Array
from servobench.core.finding import Finding
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import about_fit
from servobench.identification.trust.doubts.lag_not_split import widen_for_lag_split
from servobench.identification.uncertainty.identifiability import State, parameter_statuses
from tests.datasets import QUANTUM
from tests.identification.test_one_level import stepped

NAMES = ("gain", "time_constant", "delay")


COARSE = 1.0  # rad: a tenth of a second at 50 rad/s is five steps of such a sensor


def fit_with(gain: float, tau: float, delay: float, correlation: float, quantum: float = COARSE) -> Fit:
    """A fit of the reference motor (τ of 0.1 s) whose parameters have these standard deviations, in parts of gain and τ."""
    fine = stepped(0.0, 2.0, 1.0, 3.0)
    data = replace(fine, y=(np.floor(fine.y / quantum) + 0.5) * quantum, quantum=quantum)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order"], [data])
    scale = np.array([gain * fit["gain"].value, *(s * fit["time_constant"].value for s in (tau, delay))])
    ties = np.eye(3)
    ties[1, 2] = ties[2, 1] = correlation
    covariance = fit.covariance.copy()
    at = [fit.model.names.index(name) for name in NAMES]
    covariance[np.ix_(at, at)] = ties * np.outer(scale, scale)
    return replace(fit, covariance=covariance, intervals={})


def variance_of_the_lag(fit: Fit) -> float:
    weights: Array = np.array([name in ("time_constant", "delay") for name in fit.model.names], dtype=float)
    return float(weights @ fit.covariance @ weights)


def told(fit: Fit) -> dict[str, Finding]:
    return {finding.code: finding for finding in (*fit.findings, *about_fit(fit))}


def test_a_known_sum_of_unknown_parts_is_no_reason_to_refuse() -> None:
    before = fit_with(gain=0.01, tau=0.7, delay=0.7, correlation=-0.99)
    after = widen_for_lag_split(before)

    assert "lag-not-split" not in told(before)
    assert "lag-not-split" in told(after)
    assert told(after)["lag-not-split"].severity == "info"


def test_the_sum_keeps_its_variance_and_each_part_may_be_all_of_it() -> None:
    before = fit_with(gain=0.01, tau=0.7, delay=0.7, correlation=-0.99)
    after = widen_for_lag_split(before)

    lag = after["time_constant"].value + after["delay"].value
    assert variance_of_the_lag(after) == pytest.approx(variance_of_the_lag(before), rel=1e-9)
    for name in ("time_constant", "delay"):
        low, high = after[name].interval
        assert low <= 0.01 * lag
        assert high >= lag
        # All splits of the lag being as likely, one lies at least lag/√12 from any estimate in the mean square.
        assert after[name].sd >= np.hypot(before[name].sd, lag / np.sqrt(12))
    assert after["gain"] == before["gain"]


@pytest.mark.parametrize(
    "sizes",
    [
        {"gain": 0.01, "tau": 0.4, "delay": 0.4, "correlation": -0.99},  # the time constant is known
        {"gain": 0.01, "tau": 0.7, "delay": 0.7, "correlation": 0.0},  # nor is the sum
        {"gain": 0.60, "tau": 0.7, "delay": 0.7, "correlation": -0.99},  # nor is the gain
    ],
)
def test_what_is_known_stays_and_what_is_not_is_refused(sizes: dict[str, float]) -> None:
    before = fit_with(**sizes)

    assert widen_for_lag_split(before) is before


def test_a_fine_sensor_is_no_reason_so_that_the_input_or_the_model_must_be() -> None:
    before = fit_with(gain=0.01, tau=0.7, delay=0.7, correlation=-0.99, quantum=QUANTUM)

    assert widen_for_lag_split(before) is before


def test_a_lag_of_which_nothing_is_known_is_refused() -> None:
    before = fit_with(gain=0.01, tau=0.7, delay=0.7, correlation=-0.99)
    at = [before.model.names.index(name) for name in ("time_constant", "delay")]
    before.covariance[at, at] = np.inf

    assert widen_for_lag_split(before) is before
    assert parameter_statuses(before)["time_constant"].state is State.UNKNOWN


def test_no_part_is_longer_than_the_sum_may_be() -> None:
    """The delay may be below zero by the two rows that columns may be out of step, and the sum by its own interval."""
    before = fit_with(gain=0.01, tau=0.9, delay=0.9, correlation=-0.995)
    after = widen_for_lag_split(before)
    lag = after["time_constant"].value + after["delay"].value
    half = 1.96 * np.sqrt(variance_of_the_lag(before))
    step = before.records[0].data.sample_time

    assert before["time_constant"].interval[1] > after.intervals["time_constant"][1]
    assert after.intervals["time_constant"][1] == pytest.approx(lag + half + 2 * step, rel=1e-3)

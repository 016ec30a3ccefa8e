"""A pendulum that swung too little to tell an offset from gravity's part by the cosine."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import about_fit
from tests.rig.motor.odd_motor import OddMotor, odd_record

T = np.arange(4000) * 0.002
PENDULUM = OddMotor(gain=3.0, time_constant=0.15, coulomb=0.3, gravity_sine=4.0)


@cache
def pendulum(voltage: float) -> Fit:
    """A fit of a pendulum under a chirp of so many volts."""
    u = voltage * np.sin(2 * np.pi * (0.3 + 0.1 * T) * T)
    record = odd_record(PENDULUM, 5, samples=len(T), u=u)
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb_gravity"], [record])


def fit_of_swings(voltage: float, cosine_sd: float) -> Fit:
    """The same with standard deviations that are scaled to that of the cosine."""
    fit = pendulum(voltage)
    return replace(fit, covariance=(cosine_sd / fit["gravity_voltage_cosine"].sd) ** 2 * fit.covariance)


def told(fit: Fit) -> list[str]:
    return [finding.code for finding in about_fit(fit)]


def test_a_small_swing_ties_the_offset_to_the_cosine() -> None:
    assert "swing-small" in told(fit_of_swings(voltage=1.2, cosine_sd=2.0))


def test_a_cosine_that_is_known_all_the_same_is_no_doubt() -> None:
    assert "swing-small" not in told(fit_of_swings(voltage=1.2, cosine_sd=0.5))


def test_a_swing_by_a_right_angle_to_either_side_tells_them_apart() -> None:
    fit = fit_of_swings(voltage=7.0, cosine_sd=2.0)

    assert np.ptp(fit.records[0].prediction) > np.pi
    assert "swing-small" not in told(fit)


def test_a_shaft_that_turned_round_and_round_did_not_swing_too_little() -> None:
    """Whatever ties the two together there, a larger swing wouldn't part them."""
    fit = fit_of_swings(voltage=1.2, cosine_sd=2.0)
    (record,) = fit.records
    turned = np.where(np.arange(len(record.prediction)) < 2000, 0.0, 2 * np.pi)
    far = replace(record, prediction=record.prediction + turned)

    assert "swing-small" not in told(replace(fit, records=(far,)))

"""A sensor of the speed that shows something while the shaft stands."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

STEP, GAIN, TAU, FRICTION = 0.01, 20.0, 0.1, 1.0
LEVELS = np.array(
    [0.0, 3.0, 0.0, -3.0, 0.5, 2.0, 0.0, -4.0, -0.5, 4.0]
)  # V; below 1 V friction holds the shaft


@cache
def fit_with_zero(zero: float, sd: float = 0.05) -> Fit:
    """A motor that friction holds between its levels, whose sensor shows so much more [rad/s], with noise of a deviation sd."""
    u = np.repeat(LEVELS, 100)
    y, decay = np.zeros(len(u)), np.exp(-STEP / TAU)
    for k in range(1, len(u)):
        sense = np.sign(y[k - 1]) or np.sign(u[k - 1]) * (abs(u[k - 1]) > FRICTION)
        end = GAIN * (u[k - 1] - FRICTION * sense)
        y[k] = end + decay * (y[k - 1] - end)
        y[k] = 0.0 if y[k] * sense <= 0.0 else y[k]
    noise = sd * np.random.default_rng(1).standard_normal(len(u))
    data = dataset(seed=1, samples=len(u), sample_time=STEP, u=u, y=y + noise + zero, chain="derivative")
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])


def codes(fit: Fit) -> list[str]:
    return [each.code for each in DOUBTS["sensor_zero"].about_fit(fit)]


@pytest.mark.parametrize("zero", [5.0, -5.0, 2.0, 0.4])
def test_what_is_shown_at_rest_whichever_way_it_turned_before_is_reported(zero: float) -> None:
    (finding,) = DOUBTS["sensor_zero"].about_fit(fit_with_zero(zero))

    assert finding.code == "sensor-zero"
    shown = float(finding.sentence.split(" reads ")[1].split("\u00a0")[0].replace("−", "-"))
    assert shown == pytest.approx(zero, abs=0.05)  # as much as the noise of single samples


def test_noise_of_the_size_of_the_zero_does_not_hide_it() -> None:
    assert codes(fit_with_zero(5.0, sd=3.0)) == ["sensor-zero"]


def test_a_zero_that_is_less_than_friction_is_known_to_is_left_alone() -> None:
    fit = fit_with_zero(0.4)
    at = fit.model.names.index("coulomb_voltage")
    covariance = fit.covariance.copy()
    covariance[at, at] = (0.4 / GAIN) ** 2

    assert codes(replace(fit, covariance=covariance)) == []


@pytest.mark.parametrize("sd", [0.05, 3.0])
def test_a_sensor_that_shows_zero_is_right(sd: float) -> None:
    assert codes(fit_with_zero(0.0, sd)) == []


def test_a_shaft_that_creeps_now_one_way_now_the_other_is_no_zero_of_the_sensor() -> None:
    (record,) = fit_with_zero(0.0).records
    creeps = np.where(record.prediction == 0.0, 3.0 * np.sign(np.sin(record.data.t_output)), record.data.y)
    fit = replace(fit_with_zero(0.0), records=(replace(record, data=replace(record.data, y=creeps)),))

    assert codes(fit) == []


def test_a_position_has_no_zero() -> None:
    data = dataset(seed=1, kind="square", samples=2000, truth=Truth(coulomb_torque=1e-3))
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])

    assert codes(fit) == []

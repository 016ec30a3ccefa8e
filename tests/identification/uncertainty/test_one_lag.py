"""A pure delay with reversals costs no width, and a winding in its place is covered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.estimators.covariance import inverse
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.one_lag import lag_covariance
from servobench.identification.uncertainty.score_test import innovations_and_jacobian
from tests.datasets import QUANTUM, dataset, prbs
from tests.rig.motor.reference import Truth

STEP, SAMPLES, RECORDS = 0.002, 3000, 4
MOTOR = Truth(coulomb_torque=8e-4, inductance=1e-9)
GAIN = MOTOR.motor_constant / (MOTOR.resistance * MOTOR.viscous_friction + MOTOR.motor_constant**2)
T = np.arange(SAMPLES) * STEP
INPUTS = {
    "sine": 3.0 * np.sin(2 * np.pi * T),
    "chirp": 3.0 * np.sin(2 * np.pi * (0.2 * T + 0.5 * T**2)),
    "reversals": 2.0
    * np.where(np.random.default_rng(3).random(SAMPLES // 25 + 1) < 0.5, -1.0, 1.0).repeat(25)[:SAMPLES],
}


@pytest.mark.parametrize("name", INPUTS)
def test_a_pure_delay_with_friction_and_reversals_costs_no_width(name: str) -> None:
    """The errors of the gain over their stated standard deviations have a root mean square of one, within what chance allows.

    It is chi over RECORDS normal numbers: below 0.2 with a probability of 1e-3, above 2.2 with one of 4e-4. A whole delay charged
    to an unseen winding made it 0.01.
    """
    late = np.concatenate([[0.0], INPUTS[name][:-1]])
    ratios = []
    for seed in range(RECORDS):
        # The voltage acts a sample after the one that it is written down for.
        acting = dataset(seed=seed, u=late, samples=SAMPLES, sample_time=STEP, truth=MOTOR)
        told = dataset(seed=seed, u=INPUTS[name], samples=SAMPLES, sample_time=STEP, y=acting.y)
        fit = identify(told).fit
        assert fit is not None
        ratios.append((fit["gain"].value - GAIN) / fit["gain"].sd)
    assert 0.2 < float(np.sqrt(np.mean(np.square(ratios)))) < 2.2


@pytest.mark.parametrize("seed", range(1, 5))
def test_many_reversals_behind_a_pure_delay_say_that_it_is_one(seed: int) -> None:
    """Then the gain has the standard deviation that white residuals make, (J'J)⁻¹ s², and no more than a third beyond.

    Friction of a quarter of the input, bits of 0.9 τ, a sample of delay, and noise of a count. With an error of its own for each
    of some 20 reversals the standard deviation was four to ten times that.
    """
    motor, samples, step = Truth(coulomb_torque=4e-3, inductance=1e-9), 400, 0.015
    u = prbs(samples, 6, np.random.default_rng(seed))
    late = np.concatenate([[0.0], u[:-1]])
    acting = dataset(seed=seed, u=late, samples=samples, sample_time=step, truth=motor)
    noise = QUANTUM * np.random.default_rng(seed).standard_normal(samples)
    data = dataset(seed=seed, u=u, samples=samples, sample_time=step, y=acting.y + noise)

    fit = identify(replace(data, quantum=None)).fit

    assert fit is not None
    jacobian, _ = innovations_and_jacobian(fit)
    white = inverse(jacobian.T @ jacobian)[0, 0]
    assert fit.model.names[0] == "gain"
    assert fit["gain"].sd < 1.33 * float(np.sqrt(white))


def test_one_lag_acts_in_all_records() -> None:
    """Twice the same record says twice as much of the lag, and leaves less of it open than one does, not as much."""
    winding = Truth(coulomb_torque=8e-4, inductance=0.02 * 0.099 * MOTOR.resistance)
    data = dataset(seed=1, u=INPUTS["sine"], samples=SAMPLES, sample_time=STEP, truth=winding)
    method, structure = ESTIMATORS["output_error"], STRUCTURES["first_order_coulomb"]

    alone, both = (lag_covariance(method.fit(structure, records)) for records in ([data], [data, data]))

    assert 0.0 < both[0, 0] <= alone[0, 0]
    # Were the lags of the two records independent, the mean of both would have half the variance.
    assert both[0, 0] > 0.6 * alone[0, 0]


def test_a_fit_without_a_delay_has_no_such_line() -> None:
    data = dataset(seed=1, u=INPUTS["sine"], samples=SAMPLES, sample_time=STEP, truth=MOTOR)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])
    theta = np.where(np.array(fit.model.names) == "delay", 0.0, fit.model.theta)

    assert not lag_covariance(replace(fit, model=replace(fit.model, theta=theta))).any()


def test_a_winding_behind_reversals_is_still_covered() -> None:
    """A lag of 2 % of the time constant in a sine of one frequency, where a delay in its place fits nearly as well.

    The gain is that of the motor, whatever the lag. One record: 1.96 standard deviations would be missed by one in twenty, 3 by
    one in 400.
    """
    winding = Truth(coulomb_torque=8e-4, inductance=0.02 * 0.099 * MOTOR.resistance)
    fit = identify(dataset(seed=1, u=INPUTS["sine"], samples=SAMPLES, sample_time=STEP, truth=winding)).fit
    assert fit is not None
    assert abs(fit["gain"].value - GAIN) < 3 * fit["gain"].sd

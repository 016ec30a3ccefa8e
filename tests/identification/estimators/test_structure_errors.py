"""What the residuals leave of the errors that a structure knows of."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.identify import identify
from tests.datasets import dataset
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


def test_a_winding_behind_reversals_is_still_covered() -> None:
    """A lag of 2 % of the time constant in a sine of one frequency, where a delay in its place fits nearly as well.

    The gain is that of the motor, whatever the lag. One record: 1.96 standard deviations would be missed by one in twenty, 3 by
    one in 400.
    """
    winding = Truth(coulomb_torque=8e-4, inductance=0.02 * 0.099 * MOTOR.resistance)
    fit = identify(dataset(seed=1, u=INPUTS["sine"], samples=SAMPLES, sample_time=STEP, truth=winding)).fit
    assert fit is not None
    assert abs(fit["gain"].value - GAIN) < 3 * fit["gain"].sd

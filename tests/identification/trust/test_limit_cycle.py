"""A relay's limit cycle is told; a PRBS isn't one, however little a coarse or noisy sensor sees of the motion in a bit."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset, prbs
from tests.rig.motor.reference import Truth, march

STEP = 0.002


def codes(data: Dataset) -> set[str]:
    about = DOUBTS["limit_cycle"].about_data
    assert about is not None
    return {finding.code for finding in about([data])}


def read(u: np.ndarray, angle: np.ndarray, counts: int, noise: float, seed: int) -> Dataset:
    """The record of an encoder with so many counts in a turn, and `noise` of them in a reading."""
    quantum = 2 * np.pi / counts
    shaken = angle + noise * quantum * np.random.default_rng(seed).standard_normal(len(u))
    return dataset(seed=1, samples=len(u), u=u, y=np.floor(shaken / quantum) * quantum)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize(("counts", "noise"), [(4, 0.0), (100, 1.6)])
def test_a_prbs_is_no_limit_cycle(seed: int, counts: int, noise: float) -> None:
    """Bits of 27 samples, half a time constant: the shaft hardly goes farther than the sensor's steps and noise in one."""
    u = prbs(1500, 27, np.random.default_rng(seed)) / 3.0
    angle = march(Truth(), u, STEP, angle=0.3)[:, 2]

    assert codes(read(u, angle, counts, noise, seed)) == set()


def test_a_relay_with_hysteresis_makes_one() -> None:
    """3 V away from where the shaft was last, turned at ±0.5 rad, with noise: its times differ by more than a clock's."""
    truth, angle, random = Truth(), 0.0, np.random.default_rng(1)
    gain = truth.motor_constant / (truth.resistance * truth.viscous_friction + truth.motor_constant**2)
    tau = (
        truth.inertia
        * truth.resistance
        / (truth.resistance * truth.viscous_friction + truth.motor_constant**2)
    )
    speed, volts, us, angles = 0.0, 3.0, [], []
    for _ in range(5000):
        us.append(volts)
        angles.append(angle)
        seen = angle + 0.1 * random.standard_normal()
        if volts * seen > 3.0 * 0.5:
            volts = -volts
        speed += (gain * volts - speed) * -np.expm1(-STEP / tau)
        angle += STEP * speed

    assert codes(read(np.array(us), np.array(angles), 2048, 1.0, 2)) == {"limit-cycle"}

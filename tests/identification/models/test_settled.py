"""The speeds that a motor settles at under constant inputs."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.models.settled import settled_speeds
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

TRUTH = Truth(viscous_friction=0.0, coulomb_torque=8e-4)


@pytest.mark.parametrize("chain", ["", "derivative"])
def test_the_speed_of_each_level_is_that_of_the_equations(chain: str) -> None:
    """ω = (u - R T_c/k)/k; behind a derivative a count is 1.5 rad/s in one sample, and 50 samples average it out."""
    levels = np.array([2.0, 4.0, -3.0])
    data = dataset(seed=1, samples=1500, u=np.repeat(levels, 500), truth=TRUTH, chain=chain)
    lost = TRUTH.resistance * TRUTH.coulomb_torque / TRUTH.motor_constant

    settled = settled_speeds(data)

    assert [each.level for each in settled] == list(levels)
    expected = (levels - lost * np.sign(levels)) / TRUTH.motor_constant
    # What is left of the step in the last half second, five time constants: 7 in 1000, and a count in it.
    assert [each.speed for each in settled] == pytest.approx(list(expected), rel=0.01)


def test_a_speed_that_still_grows_has_not_settled() -> None:
    """0.1 s under each level, a time constant."""
    data = dataset(seed=1, samples=250, u=np.repeat([2.0, 4.0, 6.0, 8.0, 10.0], 50), truth=TRUTH)

    assert settled_speeds(data) == []

"""A test of one level among others, as SysId's dynamic ones: it can't tell its gain from its friction."""

import numpy as np
import pytest

from servobench.identification.trust.explanations.base import explain
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

T = 0.002 * np.arange(3000)


def ramp() -> Dataset:
    return dataset(seed=1, samples=len(T), u=np.minimum(T, 6.0))


@pytest.mark.parametrize("level", [2.0, 3.0])
@pytest.mark.parametrize("friction", [2.4e-3, 4e-3])  # N·m, three and five times the ramp's
def test_other_friction_in_a_step_is_not_taken_for_another_motor(level: float, friction: float) -> None:
    step = dataset(seed=2, samples=len(T), u=np.full(len(T), level), truth=Truth(coulomb_torque=friction))

    assert "records-disagree" not in [each.code for each in explain([ramp(), step])]


def test_a_step_with_half_of_its_voltage_is_still_reported() -> None:
    half = dataset(seed=2, samples=len(T), u=np.full(len(T), 3.0))
    labelled = dataset(seed=2, samples=len(T), u=np.full(len(T), 6.0), y=half.y)
    square = dataset(seed=1, samples=len(T))

    assert "records-disagree" in [each.code for each in explain([square, square, labelled])]

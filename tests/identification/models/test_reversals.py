"""What a lag in place of a part of the delay does where friction switches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.reversals import late_friction
from tests.datasets import dataset
from tests.rig.motor.reference import Truth, march

FINE, SAMPLE = 1e-3, 2e-3
STEP = 5e-6
RESISTANCE, CONSTANT = 8.4, 0.042
TAU, LAG = 0.1, 0.5 * SAMPLE


def moved(u: np.ndarray, lag: float, friction: float) -> np.ndarray:
    """The angle at the samples of a motor with the poles 1/TAU and 1/lag, for an input held for two short steps.

    J L s² + J R s + k² = k² (TAU s + 1) (lag s + 1) without viscous friction.
    """
    inertia = (TAU + lag) * CONSTANT**2 / RESISTANCE
    truth = Truth(
        resistance=RESISTANCE,
        motor_constant=CONSTANT,
        inertia=inertia,
        inductance=TAU * lag * CONSTANT**2 / inertia,
        viscous_friction=0.0,
        coulomb_torque=friction,
    )
    return np.asarray(march(truth, u, FINE, step=STEP)[::2, 2])


@pytest.mark.parametrize("hold", [7, 20])
def test_the_error_is_that_of_a_motor_with_a_winding_in_place_of_the_delay(hold: int) -> None:
    """Half a sample of delay against a winding of half a sample, each with and without friction, in steps of 5 µs.

    In the reference friction switches within a step of 5 µs, half a percent of the lag, at each of the reversals.
    """
    data = dataset(seed=1, kind="prbs", hold=hold, samples=1000, y=np.zeros(1000))
    fine, friction = np.repeat(data.u, 2), 8e-4
    late = np.concatenate([[0.0], fine[:-1]])
    expected = (moved(fine, LAG, friction) - moved(late, 1e-9, friction)) - (
        moved(fine, LAG, 0.0) - moved(late, 1e-9, 0.0)
    )
    p = np.array([1 / CONSTANT, TAU, 0.0, friction * RESISTANCE / CONSTANT, LAG, 0.0, 0.0])

    (error,) = late_friction(p, data).T * np.sqrt(3.0)

    assert np.abs(expected).max() > 1e-3  # a third of a count and more: there is something to compare
    assert np.sqrt(np.mean((error - expected) ** 2)) < 0.04 * np.sqrt(np.mean(expected**2))


def test_without_a_delay_or_friction_there_is_no_error() -> None:
    data = dataset(seed=1, kind="prbs", samples=500, y=np.zeros(500))
    p = np.array([23.7, 0.1, 0.0, 0.2, 0.0, 0.0, 0.0])
    without_friction = np.array([23.7, 0.1, 0.0, 0.0, 0.001, 0.0, 0.0])

    assert late_friction(p, data).shape == (500, 0)
    assert late_friction(without_friction, data).shape == (500, 0)


def test_gravity_moves_the_place_where_friction_switches_and_is_no_error_itself() -> None:
    """With gravity of zero the structure that has it knows the same error as the one that hasn't; with some, another one."""
    data = replace(dataset(seed=1, kind="prbs", samples=500), input_before=0.0)
    plain = np.array([23.7, 0.1, 0.2, 0.05, 0.0011, 0.3, 1.0])
    arm = STRUCTURES["first_order_coulomb_gravity"]
    names = [parameter.name for parameter in arm.parameters]
    value = {
        "gain": 23.7, "time_constant": 0.1, "coulomb_voltage": 0.2, "offset_voltage": 0.05, "delay": 0.0011,
        "gravity_voltage_sine": 0.0, "gravity_voltage_cosine": 0.0,
    }  # fmt: skip
    of_plain = STRUCTURES["first_order_coulomb"].unmodelled(plain, data)

    without = arm.unmodelled(np.array([*(value[name] for name in names), 0.3, 1.0]), data)
    value["gravity_voltage_sine"] = 0.8
    with_gravity = arm.unmodelled(np.array([*(value[name] for name in names), 0.3, 1.0]), data)

    np.testing.assert_allclose(without, of_plain, atol=1e-9)
    assert np.abs(with_gravity - of_plain).max() > 0.05 * np.abs(of_plain).max()

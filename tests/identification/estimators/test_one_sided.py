"""A parameter at a bound of nature may lie beyond it on the side that can be, and the others' intervals say so."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from servobench.identification.estimators.least_squares import minimise
from servobench.identification.estimators.output_error import mean_square_beyond, uncertainty
from servobench.identification.models.base import STRUCTURES
from tests.datasets import dataset
from tests.rig.motor.reference import Truth


@pytest.mark.parametrize("mean", [-6.0, -1.0, 0.0, 2.0])
def test_the_mean_square_of_a_cut_normal_is_its_integral(mean: float) -> None:
    sd = 1.7

    def density(x: float) -> float:
        return float(np.exp(-0.5 * ((x - mean) / sd) ** 2 + 0.5 * (min(mean, 0.0) / sd) ** 2))

    top = max(mean, 0.0) + 12 * sd
    expected = quad(lambda x: x**2 * density(x), 0, top)[0] / quad(density, 0, top)[0]
    assert mean_square_beyond(mean, sd) == pytest.approx(expected, rel=1e-6)


LEVEL = 3.0


def step_without_friction() -> tuple[float, int, int, np.ndarray]:
    """The gain from one step of a motor without friction, held at that; the places of gain and friction, and the covariance."""
    structure = STRUCTURES["first_order_one_way_rest"]
    u = np.where(np.arange(1500) < 50, 0.0, LEVEL)
    data = dataset(seed=1, u=u, samples=1500, truth=Truth(coulomb_torque=0.0, inductance=1e-9))
    names = [parameter.name for parameter in structure.parameters]
    gain, friction = names.index("gain"), names.index("coulomb_voltage")
    start = structure.guesses([data])[0].copy()
    start[friction] = 0.0
    minimum = minimise(structure, [data], start, np.arange(len(start)) != friction)
    return float(minimum.theta[gain]), gain, friction, uncertainty(structure, [data], minimum)[1]


def test_no_friction_from_one_step_is_no_knowledge_of_the_gain() -> None:
    """One level tells K (u - u_c) alone, so that dK = K/u du_c: with the friction at its bound the gain is as unsure as that is.

    Of a normal number that is cut at zero, at most 2 deviations from its middle, the root mean square is 0.4 of its deviation or
    more; by as much the friction may be above its bound, and it was held there as if that were known.
    """
    value, gain, friction, covariance = step_without_friction()
    sd = np.sqrt(np.diag(covariance))
    assert sd[gain] > 0.3 * value / LEVEL * sd[friction]


def test_the_speed_under_one_level_is_known_with_friction_at_its_bound() -> None:
    """K (u - u_c) is what a level shows; with u_c held at 0 and K as unsure as u_c is, it was as unsure as both."""
    value, gain, friction, covariance = step_without_friction()
    speed = np.zeros(len(covariance))
    speed[gain], speed[friction] = LEVEL, -value
    assert np.sqrt(speed @ covariance @ speed) < 0.2 * LEVEL * np.sqrt(covariance[gain, gain])

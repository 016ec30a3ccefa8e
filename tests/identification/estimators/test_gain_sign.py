"""A gain is of the other sign only where the data clearly say so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.gain_sign import usual_sign, with_usual_sign
from servobench.identification.estimators.least_squares import minimise
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.identifiability import State
from tests.datasets import dataset


@pytest.mark.parametrize("wires", [1, -1])
def test_one_level_gives_the_gain_the_sign_of_the_motion(wires: int) -> None:
    """K (u - u_c) is the same for K and u - u_c of the other sign: a search that begins there stays there."""
    plain = dataset(seed=1, u=np.where(np.arange(1000) < 20, 0.0, 3.0), samples=1000)
    data = replace(plain, y=wires * plain.y).part(0.05, 1e9)
    structure = STRUCTURES["first_order_one_way"]
    assert usual_sign([data]) == wires
    start = structure.guesses([data])[0].copy()
    start[:3] = -wires * 10.0, start[1], 3.0 + 3.0 * 2.4
    found = minimise(structure, [data], start)
    assert found.theta[0] * wires < 0
    usual = with_usual_sign(structure, [data], found)
    assert usual.theta[0] * wires > 0
    assert usual.cost < 1.01 * found.cost


def test_a_part_in_which_the_input_is_off_keeps_the_sign_that_was_found() -> None:
    """A held-out part may begin where the input ended: what drove the motor is before it, and there is no level to start from."""
    plain = dataset(seed=1, u=np.where(np.arange(1000) < 500, 3.0, 0.0), samples=1000)
    structure = STRUCTURES["first_order_coulomb"]
    start = structure.guesses([plain])[0].copy()
    coasting = plain.part(float(plain.t_output[500]), 1e9)
    assert usual_sign([coasting]) == 1
    assert not coasting.u.any()
    start[0] = -10.0
    found = minimise(structure, [coasting], start, free=np.arange(len(start)) > 0)
    assert found.theta[0] == -10.0
    assert with_usual_sign(structure, [coasting], found) is found


def test_a_drift_of_the_speed_is_no_reason_for_a_gain_of_the_other_sign() -> None:
    """From 5 to 6 V in the first row of a motor that runs already, and slows down by 1.5 % later on."""
    t = 0.1 * np.arange(50)
    plain = dataset(seed=1, samples=50, sample_time=0.1, u=np.where(t < 0.05, 5.0, 6.0))
    y = np.cumsum(np.where(t < 2.0, 25.57, 25.2) * 0.1) + 0.06 * np.random.default_rng(1).standard_normal(50)
    data = replace(plain, y=y, quantum=None, input_before=5.0)

    result = identify(data)

    assert result.fit is not None
    assert result.fit.model["gain"] > 0
    assert result.answers["delay"].state is not State.KNOWN

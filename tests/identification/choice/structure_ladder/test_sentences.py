"""A term that is kept is claimed only where its size is told from zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.choice.structure_ladder.sentences import rung_finding
from servobench.identification.choice.structure_ladder.trial import Rung
from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.models.base import STRUCTURES
from tests.rig.motor.odd_motor import OddMotor, odd_record

T = np.arange(2000) * 0.002
ARM = OddMotor(gain=3.0, time_constant=0.15, coulomb=0.3, gravity_sine=2.0)


@pytest.mark.parametrize(("widened", "code"), [(1.0, "gravity-found"), (1e10, "term-possible")])
def test_gravity_is_claimed_only_where_it_is_reported_from_zero(widened: float, code: str) -> None:
    record = odd_record(ARM, 5, samples=len(T), u=6.0 * np.sin(2 * np.pi * (0.3 + 0.1 * T) * T))
    plain, fit = (
        ESTIMATORS["output_error"].fit(STRUCTURES[name], [record])
        for name in ("first_order_coulomb", "first_order_coulomb_gravity")
    )
    wide = replace(fit, covariance=widened * fit.covariance)

    told = rung_finding(Rung(term="gravity", plain=fit, fit=wide, doubt=""), plain, plain)

    assert told.code == code
    assert ("don't show for certain" in told.sentence) == (code == "term-possible")
    assert "gravity_voltage_sine" in told.parameters


def test_a_torque_that_repeats_with_each_turn_is_called_no_arm() -> None:
    """A wheel's motor was said to be under gravity: whatever repeats with each turn looks like it."""
    swings, turns = (
        odd_record(ARM, 5, samples=len(T), u=level * np.sin(2 * np.pi * (0.3 + 0.1 * T) * T))
        for level in (3.0, 12.0)
    )
    told = []
    for record in (swings, turns):
        plain, fit = (
            ESTIMATORS["output_error"].fit(STRUCTURES[name], [record])
            for name in ("first_order_coulomb", "first_order_coulomb_gravity")
        )
        told.append(rung_finding(Rung(term="gravity", plain=fit, fit=fit, doubt=""), plain, plain).sentence)

    assert np.ptp(swings.y) < 4 * np.pi < np.ptp(turns.y)
    assert told[0].startswith("Gravity acts on the shaft")
    assert told[1].startswith("A torque repeats with each turn")

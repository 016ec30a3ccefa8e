"""A motor that stands undriven is carried forward at once, and moves as it would have when its voltage comes."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.rig.motor.parameters import data_sheet
from servobench.rig.motor.physics import Physics
from servobench.rig.motor.plant import Plant
from servobench.rig.motor.solvers.base import SOLVERS

TICK = 0.001  # s


def plant(solver: str) -> Plant:
    physics = replace(Physics.of(data_sheet("qube_servo_2").motor), coulomb_torque=8e-4)
    prepared = SOLVERS[solver].prepare(physics, TICK, None)
    return Plant(physics, prepared, TICK, 0.0, 0.0, np.random.default_rng(0))


@pytest.mark.parametrize("wait", [TICK, 3.0, 3.0004])
def test_a_voltage_that_comes_while_it_stands_moves_it_from_then_on(wait: float) -> None:
    waiting, fresh = plant("exact"), plant("exact")
    waiting.act(3.0, wait)
    fresh.act(3.0, 0.0)

    assert waiting.advance_to(wait) == fresh.advance_to(0.0)
    # The same ticks from another time on, which rounds by 4e-16 s.
    np.testing.assert_allclose(waiting.advance_to(wait + 0.25), fresh.advance_to(0.25), rtol=1e-9)


def test_a_shaft_that_turns_undriven_goes_on_until_it_stands() -> None:
    turning = plant("exact")
    turning.act(3.0, 0.0)
    turning.act(0.0, 0.5)
    before = turning.advance_to(0.5)

    assert turning.advance_to(0.51).angle > before.angle
    stopped = turning.advance_to(10.0)
    assert stopped.speed == 0.0
    assert turning.advance_to(1000.0) == stopped

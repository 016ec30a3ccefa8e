"""The rotary pendulum against what doesn't come from its equations: energy, its period, and a falling rod."""

import math
from dataclasses import replace

import numpy as np
import pytest

from servobench.rig.motor.parameters import QUBE_SERVO_3
from servobench.rig.motor.pendulum import GRAVITY, Rod, RotaryPendulum
from servobench.rig.motor.physics import Physics

MOTOR = replace(QUBE_SERVO_3.motor, disc_inertia=0.0)
ROD = Rod()


def pendulum(
    rod: Rod = ROD, *, angle: float = 0.0, resistance: float = 7.5, **friction: float
) -> RotaryPendulum:
    """A pendulum; a huge resistance takes the motor's brake away."""
    motor = replace(MOTOR, resistance=resistance, **friction)
    return RotaryPendulum(Physics.of(motor), rod, rod_angle=angle)


def swings(plant: RotaryPendulum, duration: float, step: float) -> np.ndarray:
    """Angles of arm and rod, and the energy, at each step."""
    rows = []
    for k in range(round(duration / step)):
        plant.advance_to(k * step)
        rows.append((plant.pendulum.arm, plant.pendulum.rod, plant.energy))
    return np.array(rows)


@pytest.mark.parametrize("angle", [0.3, 1.5, 3.0])
def test_without_friction_and_motor_energy_stays_what_it_was(angle: float) -> None:
    found = swings(pendulum(replace(ROD, damping=0.0), angle=angle, resistance=1e12), 10.0, 0.01)

    assert np.ptp(found[:, 0]) > 0.1  # the arm swings, too
    # The fourth-order method loses about (ω h)^5 / 144 of the energy a step: with ω up to 30 rad/s and h of 0.5 ms that is
    # 5e-12, times 2e4 steps.
    assert np.abs(found[:, 2] / found[0, 2] - 1).max() < 1e-5


def test_without_outer_torque_the_angular_momentum_about_the_axis_stays_what_it_was() -> None:
    plant = pendulum(replace(ROD, damping=0.0), angle=2.5, resistance=1e12)
    inertia = ROD.arm_inertia(Physics.of(MOTOR).inertia)
    for k in range(500):
        plant.advance_to(k * 0.01)
        _, w, alpha, v = plant.pendulum
        # Of arm and rod: J_a + m r² + P sin² α of the turning, and m r times the rod's own speed across.
        momentum = (inertia + ROD.inertia * math.sin(alpha) ** 2) * w + ROD.coupling * math.cos(alpha) * v
        assert abs(momentum) < 1e-9


def test_with_the_arm_held_the_rod_swings_with_the_period_of_a_physical_pendulum() -> None:
    plant = pendulum(replace(ROD, damping=0.0), angle=0.02)
    plant.blocked = True
    rod = swings(plant, 5.0, 1e-3)[:, 1]
    crossings = np.flatnonzero((rod[:-1] > 0) & (rod[1:] <= 0))
    period = np.diff(crossings).mean() * 1e-3

    # 2π √(2 L / (3 g)) of a thin rod, longer by α²/16 for its amplitude; resolved to a step in seven periods.
    expected = 2 * math.pi * math.sqrt(2 * ROD.length / (3 * GRAVITY))
    assert abs(period - expected) < 1e-3 / 7 * 2


def test_a_free_arm_makes_the_rod_swing_faster() -> None:
    rod = swings(pendulum(replace(ROD, damping=0.0), angle=0.02, resistance=1e12), 5.0, 1e-3)[:, 1]
    crossings = np.flatnonzero((rod[:-1] > 0) & (rod[1:] <= 0))
    frequency = 2 * math.pi / (np.diff(crossings).mean() * 1e-3)

    # The reduced mass of two coupled oscillators, one without a spring: ω² = m g l / (P - c²/J_a).
    arm = ROD.arm_inertia(Physics.of(MOTOR).inertia)
    expected = math.sqrt(ROD.weight / (ROD.inertia - ROD.coupling**2 / arm))
    assert abs(frequency / expected - 1) < 1e-3


def test_an_arm_that_is_pushed_leaves_the_hanging_rod_behind() -> None:
    plant = pendulum()
    plant.act(3.0, 0.0)
    plant.advance_to(0.02)

    assert plant.pendulum.arm > 0 > plant.pendulum.rod


def test_an_upright_rod_falls_away_from_where_it_leans() -> None:
    plant = pendulum(angle=math.pi - 0.01)
    plant.advance_to(0.2)

    assert plant.pendulum.rod < math.pi - 0.05


def test_a_rod_in_the_hand_stays_where_it_is_held_while_the_arm_turns() -> None:
    plant = pendulum()
    plant.hold(1.0, 0.0)
    plant.act(3.0, 0.0)
    plant.advance_to(0.5)

    assert plant.pendulum.rod == 1.0
    assert plant.pendulum.arm > 0.5
    plant.release()
    plant.advance_to(0.6)
    assert plant.pendulum.rod != 1.0


def test_coulomb_friction_holds_the_arm() -> None:
    plant = pendulum(coulomb_torque=8e-4)
    plant.act(0.1, 0.0)  # 8e-4 N·m take 0.142 V
    plant.advance_to(1.0)

    # The stiff damper that stands in for sticking lets it creep below 1 mrad/s.
    assert plant.pendulum.arm < 1e-3

"""Coulomb friction for solvers with fixed steps: their treatment of standstill."""

from __future__ import annotations

from servobench.rig.motor.physics import Physics


def direction(physics: Physics, current: float, speed: float) -> float:
    """Return the direction in which the shaft slides or starts to slide, 1 or -1; 0 where it sticks.

    At rest it starts only if the motor's torque k i [N·m], from the current [A], is larger than the Coulomb torque.
    Without Coulomb torque it never sticks, and its direction doesn't matter.
    """
    if physics.coulomb_torque == 0.0:
        return 1.0
    if speed != 0.0:
        return 1.0 if speed > 0 else -1.0
    torque = physics.motor_constant * current
    if abs(torque) <= physics.coulomb_torque:
        return 0.0
    return 1.0 if torque > 0 else -1.0


def has_stopped(before: float, after: float) -> bool:
    """Return whether a shaft that slid in a direction (±1, 0 for none) has come to rest or beyond at a speed [rad/s]."""
    return before != 0.0 and after * before < 0.0

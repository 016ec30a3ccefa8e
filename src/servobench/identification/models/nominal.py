"""The model's parameters according to a data sheet."""

from __future__ import annotations

import math

from servobench.rig.motor.parameters import MotorParameters


def nominal_values(motor: MotorParameters) -> dict[str, float]:
    """Return the nominal `gain`, `time_constant` and `delay`, and `coulomb_voltage` where the sheet knows friction.

    With p = (s L + R)(s J + b) + k²: gain K = k / (R b + k²), the time constant is that of the slow root of p, and a first-order
    model shows the fast root's time constant as a delay. SI units.
    They follow from L di/dt + R i = u - k ω and J dω/dt = k i - b ω - T_c sgn(ω).
    """
    r, l, k = motor.resistance, motor.inductance, motor.motor_constant
    j, b = motor.inertia, motor.viscous_friction
    stiffness = r * b + k * k
    half = 0.5 * (j * r + l * b)
    root = math.sqrt(max(half * half - j * l * stiffness, 0.0))
    # The roots of p(s) = J L s² + (J R + L b) s + (R b + k²) as time constants; this form doesn't cancel for a small L.
    values = {
        "gain": k / stiffness,
        "time_constant": (half + root) / stiffness,
        "delay": j * l / (half + root),
    }
    if motor.coulomb_torque > 0:
        values["coulomb_voltage"] = motor.coulomb_torque * r / k
    return values

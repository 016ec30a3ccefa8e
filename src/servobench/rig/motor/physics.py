"""The physics of a DC motor: its equations, its time constants, and its state.

    L di/dt = v - (R + R_amp) i - k ω
    J dω/dt = k i - b ω - T_c sgn(ω) + T_d
    dθ/dt = ω

At rest the shaft sticks while |k i| <= T_c (static friction equal to Coulomb friction). T_d is a disturbance, white
noise with E[T_d(t) T_d(t')] = s² δ(t - t').
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from servobench.core.channels import Array
from servobench.core.matrix_exponential import matrix_exponential
from servobench.rig.motor.parameters import MotorParameters


class MotorState(NamedTuple):
    """Current [A], speed [rad/s] and angle [rad] of the shaft."""

    current: float
    speed: float
    angle: float


@dataclass(frozen=True, kw_only=True)
class Physics:
    """The coefficients of the motor's equations, in SI units: what the solvers work with.

    `resistance` R [Ω] and `inductance` L [H], `motor_constant` k [V·s/rad = N·m/A], `inertia` J [kg·m²] of everything that
    turns, `viscous_friction` b [N·m·s/rad], `coulomb_torque` T_c [N·m].
    """

    resistance: float
    inductance: float
    motor_constant: float
    inertia: float
    viscous_friction: float
    coulomb_torque: float

    @classmethod
    def of(cls, motor: MotorParameters, series_resistance: float = 0.0) -> Physics:
        """Return the coefficients of a motor behind an amplifier of that output resistance [Ω]."""
        return cls(
            resistance=motor.resistance + series_resistance,
            inductance=motor.inductance,
            motor_constant=motor.motor_constant,
            inertia=motor.inertia,
            viscous_friction=motor.viscous_friction,
            coulomb_torque=motor.coulomb_torque,
        )

    @property
    def matrix(self) -> Array:
        """The system matrix of (current, speed) while the shaft slides, shape (2, 2) [1/s]; needs an inductance."""
        k = self.motor_constant
        return np.array(
            [
                [-self.resistance / self.inductance, -k / self.inductance],
                [k / self.inertia, -self.viscous_friction / self.inertia],
            ]
        )

    @property
    def eigenvalues(self) -> tuple[complex, ...]:
        """The eigenvalues while the shaft slides [1/s], slowest first; one without inductance, two with it."""
        k, r, b = self.motor_constant, self.resistance, self.viscous_friction
        if self.inductance == 0:
            return (complex(-(b + k * k / r) / self.inertia),)
        values = np.linalg.eigvals(self.matrix).astype(complex)
        return tuple(complex(value) for value in sorted(values, key=abs))

    @property
    def gain(self) -> float:
        """K = k / (R b + k²): steady speed per volt [rad/(s·V)]."""
        k = self.motor_constant
        return k / (self.resistance * self.viscous_friction + k * k)

    @property
    def time_constant(self) -> float:
        """τ = -1 / slow eigenvalue [s]."""
        return -1.0 / self.eigenvalues[0].real

    @property
    def electrical_time_constant(self) -> float:
        """L / R [s]."""
        return self.inductance / self.resistance

    @property
    def coulomb_voltage(self) -> float:
        """The voltage that overcomes Coulomb friction at standstill, T_c R / k [V]."""
        return self.coulomb_torque * self.resistance / self.motor_constant


def disturbance_factor(physics: Physics, torque_noise: float, h: float) -> Array:
    """Return a factor F (3, 3) such that F n, n standard normal, is what white torque adds to the state in a time h.

    F F' = ∫₀ʰ e^(As) G s_T² G' e^(A's) ds, with G = (0, 1/J, 0), by Van Loan's matrix exponential (1978). `torque_noise` is s_T
    [N·m/√Hz], two-sided; h [s].
    """
    a = np.zeros((3, 3))
    if physics.inductance > 0:
        a[:2, :2] = physics.matrix
    else:
        a[1, 1] = physics.eigenvalues[0].real
    a[2, 1] = 1.0
    density = np.zeros((3, 3))
    density[1, 1] = (torque_noise / physics.inertia) ** 2
    # The fast electrical mode makes e^(-A h) overflow over a long tick, so the integral is built by doubling a short one.
    doublings = max(0, math.ceil(math.log2(max(h * float(np.abs(np.linalg.eigvals(a)).max()), 1e-300))) + 1)
    short = h / 2**doublings
    block = np.block([[-a, density], [np.zeros((3, 3)), a.T]]) * short
    exponential = matrix_exponential(block)
    transition = exponential[3:, 3:].T
    covariance = transition @ exponential[:3, 3:]
    for _ in range(doublings):
        covariance = covariance + transition @ covariance @ transition.T
        transition = transition @ transition
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    factor = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    if physics.inductance == 0:
        factor[0] = -physics.motor_constant / physics.resistance * factor[1]  # the current follows at once
    return np.asarray(factor, dtype=np.float64)

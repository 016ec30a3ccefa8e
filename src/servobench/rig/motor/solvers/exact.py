"""The exact solution: zero-order hold of the voltage, Coulomb friction with its switching times."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.matrix_exponential import matrix_exponential
from servobench.rig.motor.physics import MotorState, Physics
from servobench.rig.motor.solvers.base import SOLVERS


@SOLVERS.member("exact")
@dataclass(frozen=True)
class Exact:
    """Exact to rounding for any tick, as the voltage is constant during one and friction switches at times that are solved for.

    The linear step is e^(A h) of the sliding motor; friction is the implicit step (Moreau 1988) d = clip(ω_free, ±c₁), which is
    exact unless the shaft stops or starts within the tick; such a tick is cut at its switching times.
    `coefficients` (33,) are the kernels' for ticks of that length [s].
    """

    coefficients: Array
    tick: float

    @classmethod
    def prepare(cls, physics: Physics, tick: float, step: float | None) -> Exact:
        """Return the solver; `step` is not needed, as there is no step."""
        return cls(coefficients(physics, tick), tick)

    def advance(self, state: MotorState, voltage: float, duration: float) -> MotorState:
        """Return the state after a duration [s] with a constant voltage [V]."""
        from servobench.rig.motor import kernels

        if duration == self.tick:
            return MotorState(*kernels.tick(self.coefficients, *state, voltage))
        return MotorState(*kernels.advance_switching(self.coefficients, *state, voltage, duration))

    def simulate(self, state: MotorState, voltage: Array) -> Array:
        """Return current, speed and angle, shape (N + 1, 3), at every tick for the voltages (N,) [V], the start first."""
        from servobench.rig.motor import kernels

        out = np.empty((len(voltage) + 1, 3))
        kernels.simulate(self.coefficients, *state, np.ascontiguousarray(voltage, dtype=np.float64), out)
        return out


def coefficients(physics: Physics, h: float) -> Array:
    """Return the kernels' coefficients (33,) for a tick h [s], as laid out in `servobench.rig.motor.kernels`.

    From E = e^(h A₅), A₅ the matrix of (i, ω, θ) with the held voltage and friction torque as two more states.
    """
    from servobench.rig.motor import kernels as n

    c = np.zeros(n.SIZE)
    r, l, k = physics.resistance, physics.inductance, physics.motor_constant
    j, b, tc = physics.inertia, physics.viscous_friction, physics.coulomb_torque
    c[n.R], c[n.L], c[n.K], c[n.J], c[n.B], c[n.TC], c[n.H] = r, l, k, j, b, tc, h
    left = 1.0 - h * (b + k * k / r) / j
    push = h / (j * left) if left > 0.0 else math.inf
    c[n.PER_AMPERE], c[n.PER_VOLT], c[n.LEAST] = push * k, push * k / r, push * tc if tc else 0.0
    both = r * b + k * k
    c[n.I_V], c[n.I_T], c[n.W_V], c[n.W_T] = b / both, k / both, k / both, r / both
    if l == 0:
        rate = (b + k * k / r) / j
        e, g = math.exp(-rate * h), -math.expm1(-rate * h) / rate
        c[n.A11], c[n.B1], c[n.C1] = e, g * k / (r * j), g / j * tc
        c[n.T1], c[n.TB] = g, (h - g) / rate * k / (r * j)
        c[n.Q] = ((h - g) / rate) / g
        c[n.A01], c[n.B0], c[n.G] = -k / r * e, 1 / r - k / r * c[n.B1], k / r
        return c
    aii, aiw, awi, aww = -r / l, -k / l, k / j, -b / j
    m, det = 0.5 * (aii + aww), aii * aww - aiw * awi
    c[n.AII], c[n.AIW], c[n.AWI], c[n.AWW] = aii, aiw, awi, aww
    c[n.M], c[n.DET], c[n.D2] = m, det, m * m - det
    a = np.zeros((5, 5))
    a[0] = [-r / l, -k / l, 0, 1 / l, 0]
    a[1] = [k / j, -b / j, 0, 0, -1 / j]
    a[2, 1] = 1
    e5 = matrix_exponential(h * a)
    c[n.A00], c[n.A01], c[n.B0] = e5[0, 0], e5[0, 1], e5[0, 3]
    c[n.A10], c[n.A11], c[n.B1] = e5[1, 0], e5[1, 1], e5[1, 3]
    c[n.T0], c[n.T1], c[n.TB] = e5[2, 0], e5[2, 1], e5[2, 3]
    c[n.C1], c[n.G], c[n.Q] = -e5[1, 4] * tc, -e5[0, 4] / e5[1, 4], e5[2, 4] / e5[1, 4]
    return c

"""The classical Runge-Kutta method of order four (Kutta 1901)."""

from __future__ import annotations

from dataclasses import dataclass

from servobench.rig.motor.physics import MotorState, Physics
from servobench.rig.motor.solvers.base import SOLVERS, Slope, in_steps, stable_step


@SOLVERS.member("rk4")
@dataclass(frozen=True)
class RungeKutta4:
    """Four slopes a step, fourth order away from reversals, stable for h below 2.785 times the fastest time constant.

    The motor's equations are `physics`; h is the `step` [s].
    """

    physics: Physics
    step: float

    @classmethod
    def prepare(cls, physics: Physics, tick: float, step: float | None) -> RungeKutta4:
        """Return the solver; without a step, a tick is one step."""
        return cls(physics, stable_step(physics, tick, step, 2.785, "RK4"))

    def advance(self, state: MotorState, voltage: float, duration: float) -> MotorState:
        """Return the state after a duration [s] with a constant voltage [V]."""
        return in_steps(self.physics, state, voltage, duration, self.step, _rk4)


def _rk4(slope: Slope, state: MotorState, h: float) -> MotorState:
    i, w, theta = state
    i1, w1 = slope(i, w)
    i2, w2 = slope(i + h / 2 * i1, w + h / 2 * w1)
    i3, w3 = slope(i + h / 2 * i2, w + h / 2 * w2)
    i4, w4 = slope(i + h * i3, w + h * w3)
    # The angle's slopes are the speeds at the four points.
    theta += h / 6 * (w + 2 * (w + h / 2 * w1) + 2 * (w + h / 2 * w2) + (w + h * w3))
    return MotorState(i + h / 6 * (i1 + 2 * i2 + 2 * i3 + i4), w + h / 6 * (w1 + 2 * w2 + 2 * w3 + w4), theta)

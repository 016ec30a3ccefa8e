"""Forward Euler (RK1), the solver in section II.A of the paper."""

from __future__ import annotations

from dataclasses import dataclass

from servobench.rig.motor.physics import MotorState, Physics
from servobench.rig.motor.solvers.base import SOLVERS, Slope, in_steps, stable_step


@SOLVERS.member("euler")
@dataclass(frozen=True)
class Euler:
    """x(t + h) = x(t) + h f(x(t)): first order, stable only for h below twice the fastest time constant.

    f are the motor's equations, `physics`; h is the `step` [s].
    """

    physics: Physics
    step: float

    @classmethod
    def prepare(cls, physics: Physics, tick: float, step: float | None) -> Euler:
        """Return the solver; without a step, a tick is one step."""
        return cls(physics, stable_step(physics, tick, step, 2.0, "forward Euler"))

    def advance(self, state: MotorState, voltage: float, duration: float) -> MotorState:
        """Return the state after a duration [s] with a constant voltage [V]."""
        return in_steps(self.physics, state, voltage, duration, self.step, _euler)


def _euler(slope: Slope, state: MotorState, h: float) -> MotorState:
    di, dw = slope(state.current, state.speed)
    return MotorState(state.current + h * di, state.speed + h * dw, state.angle + h * state.speed)

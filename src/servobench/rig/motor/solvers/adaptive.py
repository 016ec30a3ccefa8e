"""An adaptive solver: SciPy's LSODA (Petzold 1983), stopped at every event of friction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import SimulationDiverged
from servobench.rig.motor.friction import direction
from servobench.rig.motor.physics import MotorState, Physics
from servobench.rig.motor.solvers.base import SOLVERS, slopes


@SOLVERS.member("adaptive")
@dataclass(frozen=True)
class Adaptive:
    """Steps of its own choice to a relative tolerance of 1e-10, stiff or not; slow, and independent of the exact solution.

    The motor's equations are `physics`; `max_step` [s] is the longest step that it may take.
    """

    physics: Physics
    max_step: float

    @classmethod
    def prepare(cls, physics: Physics, tick: float, step: float | None) -> Adaptive:
        """Return the solver; `step` is the longest step that it may take."""
        return cls(physics, np.inf if step is None else step)

    def advance(self, state: MotorState, voltage: float, duration: float) -> MotorState:
        """Return the state after a duration [s] with a constant voltage [V]."""
        left = duration
        for _ in range(64):
            if left <= 0:
                break
            state, left = self._phase(state, voltage, left)
        return state

    def _phase(self, state: MotorState, voltage: float, left: float) -> tuple[MotorState, float]:
        """Advance to the end or to the next event: a sliding shaft that stops, a stuck shaft that breaks away."""
        from scipy.integrate import solve_ivp

        p = self.physics
        current = state.current if p.inductance else (voltage - p.motor_constant * state.speed) / p.resistance
        sliding = direction(p, current, state.speed)
        rates = slopes(p, voltage, sliding)
        event = None
        if p.coulomb_torque > 0:
            event = _stops(sliding) if sliding else _breaks_away(p)

        def right_hand_side(_t: float, x: Array) -> Array:
            return np.array([*rates(x[0], x[1]), x[1]])

        solution = solve_ivp(
            right_hand_side, (0.0, left), [current, state.speed, state.angle],
            method="LSODA", rtol=1e-10, atol=1e-13, events=event, max_step=self.max_step,
        )  # fmt: skip
        if not solution.success or not np.isfinite(solution.y[:, -1]).all():
            raise SimulationDiverged(f"the adaptive solver gave up: {solution.message}")
        i, w, theta = (float(value) for value in solution.y[:, -1])
        if p.inductance == 0:
            i = (voltage - p.motor_constant * w) / p.resistance
        if solution.status == 1:
            return self._after_event(i, theta, sliding), left - float(solution.t[-1])
        return MotorState(i, w, theta), 0.0

    def _after_event(self, i: float, theta: float, sliding: float) -> MotorState:
        """The state just after an event: at rest, and just over the Coulomb torque where the shaft breaks away."""
        if sliding:
            return MotorState(i, 0.0, theta)
        edge = self.physics.coulomb_torque / self.physics.motor_constant * (1 + 1e-12)
        return MotorState(float(np.copysign(max(abs(i), edge), i)), 0.0, theta)


def _stops(sliding: float) -> Callable[[float, Array], float]:
    def event(_t: float, x: Array) -> float:
        return sliding * float(x[1])

    event.terminal = True  # type: ignore[attr-defined]
    event.direction = -1.0  # type: ignore[attr-defined]
    return event


def _breaks_away(physics: Physics) -> Callable[[float, Array], float]:
    def event(_t: float, x: Array) -> float:
        return physics.motor_constant * abs(float(x[0])) - physics.coulomb_torque

    event.terminal = True  # type: ignore[attr-defined]
    event.direction = 1.0  # type: ignore[attr-defined]
    return event

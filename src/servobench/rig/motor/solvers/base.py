"""The kind `motor.solvers`: how the motor's equations are carried from one tick to the next."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Protocol, Self, TypeAlias, runtime_checkable

from servobench.core.errors import SimulationDiverged
from servobench.core.registry import Registry
from servobench.rig.motor.friction import direction, has_stopped
from servobench.rig.motor.physics import MotorState, Physics

Slope: TypeAlias = Callable[[float, float], tuple[float, float]]
"""(current [A], speed [rad/s]) -> their rates of change."""


@runtime_checkable
class Solver(Protocol):
    """A solver, prepared for one motor and one tick."""

    @classmethod
    def prepare(cls, physics: Physics, tick: float, step: float | None) -> Self:
        """Return the solver for ticks of that length [s], cut into steps of at most `step` [s] where the method has steps.

        Raises `SimulationDiverged` where the step is too long for the motor's fastest time constant.
        """
        ...

    def advance(self, state: MotorState, voltage: float, duration: float) -> MotorState:
        """Return the state after a duration [s], at most a tick, with a constant voltage at the winding [V].

        Raises `SimulationDiverged` where the state is no longer finite.
        """
        ...


SOLVERS: Registry[type[Solver]] = Registry(
    "solver", "servobench.rig.motor.solvers", "servobench.motor.solvers"
)


def stable_step(physics: Physics, tick: float, step: float | None, limit: float, method: str) -> float:
    """Return the step [s], a whole part of a tick and at most `step`; without one, the tick.

    A method with fixed steps is stable while step x |fastest eigenvalue| stays below its limit; raises
    `SimulationDiverged`, which says why, above it.
    """
    chosen = tick if step is None else tick / math.ceil(tick / step - 1e-9)
    fastest = max(abs(value) for value in physics.eigenvalues)
    if chosen * fastest <= limit:
        return chosen
    electrical = physics.electrical_time_constant
    why = f"L/R = {electrical * 1e3:.3f} ms, of the winding" if electrical else f"{1e3 / fastest:.3g} ms"
    raise SimulationDiverged(
        f"{method} with a step of {chosen * 1e3:.4g} ms diverges: the motor's fastest time constant is {why}; take "
        f'a step below {limit / fastest * 1e3:.3f} ms (solver_step), leave the inductance out (inductance = "0 H"), '
        'or use solver = "exact"'
    )


def slopes(physics: Physics, voltage: float, sliding: float) -> Slope:
    """Return the rates of change of current and speed for a voltage [V] and a direction of sliding (±1, 0 for stuck)."""
    p = physics

    def rates(i: float, w: float) -> tuple[float, float]:
        if p.inductance == 0:
            i = (voltage - p.motor_constant * w) / p.resistance
        torque = p.motor_constant * i - p.viscous_friction * w - sliding * p.coulomb_torque
        emf = voltage - p.resistance * i - p.motor_constant * w
        return (emf / p.inductance if p.inductance else 0.0), (torque / p.inertia if sliding else 0.0)

    return rates


def in_steps(
    physics: Physics,
    state: MotorState,
    voltage: float,
    duration: float,
    step: float,
    method: Callable[..., MotorState],
) -> MotorState:
    """Return the state after a duration [s] in equal steps of a method; friction keeps its direction during a step.

    A shaft that would turn back within a step stops at its end: this is what a solver with fixed steps can know.
    Raises `SimulationDiverged` where a step is too long for the method.
    """
    count = max(1, math.ceil(duration / step - 1e-9))
    h = duration / count
    for _ in range(count):
        current = state.current
        if physics.inductance == 0:
            current = (voltage - physics.motor_constant * state.speed) / physics.resistance
        sliding = direction(physics, current, state.speed)
        state = method(slopes(physics, voltage, sliding), state._replace(current=current), h)
        if not (math.isfinite(state.current) and math.isfinite(state.speed)):
            raise SimulationDiverged(
                f"the solution diverged with a step of {h * 1e3:.4g} ms: use a shorter one"
            )
        if physics.coulomb_torque > 0 and has_stopped(sliding, state.speed):
            state = state._replace(speed=0.0)
    if physics.inductance == 0:
        state = state._replace(current=(voltage - physics.motor_constant * state.speed) / physics.resistance)
    return state

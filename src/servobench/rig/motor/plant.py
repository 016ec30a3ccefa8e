"""A motor in time: its state, and the voltages in its delay line."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from servobench.core.channels import Array
from servobench.rig.motor.physics import MotorState, Physics, disturbance_factor
from servobench.rig.motor.solvers.base import Solver

# Two sums of the same tick, such as 3 h - 2 h and h, differ by rounding; below this part of a tick they are the same time.
SAME = 1e-9


class Course(NamedTuple):
    """A motor's progress: `state` at the time `now` [s] under a `voltage` [V], and those `coming`, each after its time [s]."""

    state: MotorState
    now: float
    voltage: float
    coming: tuple[tuple[float, float], ...]


class Plant:
    """A motor that starts at rest at time 0 and is carried forward to any later time.

    A voltage acts from the time it is given for until the next one. Durations longer than a tick are cut into ticks, as the
    solver and the disturbance are prepared for one. While it is `blocked` its shaft is held where it is.
    """

    def __init__(
        self,
        physics: Physics,
        solver: Solver,
        tick: float,
        torque_noise: float,
        angle: float,
        random: np.random.Generator,
    ) -> None:
        self.state = MotorState(0.0, 0.0, angle)
        self.solver = solver
        self._physics, self._tick = physics, tick
        self._noise, self._random = torque_noise, random
        # The rows of the factor (3, 3) that makes the effect of white torque in a tick of standard normals; none without one.
        self._rows = _rows_of_step(physics, torque_noise, tick) if torque_noise else []
        self._now, self._voltage = 0.0, 0.0
        self.blocked = False
        self._coming: list[tuple[float, float]] = []

    def act(self, voltage: float, at: float) -> None:
        """Let a voltage at the winding [V] act from a time [s] on, which may not lie before that of an earlier one."""
        self._coming.append((at, voltage))

    def cut(self, at: float) -> None:
        """Take the voltage off from a time [s] on, with all that would have come later."""
        self._coming = [*((t, v) for t, v in self._coming if t <= at), (at, 0.0)]

    def advance_to(self, time: float) -> MotorState:
        """Carry the motor forward to a time [s] and return its state; a time that has passed changes nothing."""
        while self._coming and self._coming[0][0] <= time + SAME * self._tick:
            at, voltage = self._coming.pop(0)
            self._advance(at)
            self._voltage = voltage
        self._advance(time)
        return self.state

    @property
    def course(self) -> Course:
        """The motor's present progress, to continue from it elsewhere (`resume`)."""
        return Course(self.state, self._now, self._voltage, tuple(self._coming))

    def resume(self, course: Course) -> None:
        """Go on from where it was carried elsewhere."""
        self.state, self._now, self._voltage, coming = course
        self._coming = list(coming)

    def _advance(self, time: float) -> None:
        while (left := time - self._now) > SAME * self._tick:
            if self._stays_at_rest:
                self._now = time
                return
            whole = left > (1 - SAME) * self._tick
            step = self._tick if whole else left
            if self.blocked:
                self.state = self._hold_shaft(step)
            else:
                self.state = self.solver.advance(self.state, self._voltage, step)
                self._disturb(step)
            self._now = time if left <= (1 + SAME) * self._tick else self._now + step

    @property
    def _stays_at_rest(self) -> bool:
        """Whether nothing drives the motor, which has no current and stands still: no tick changes anything, nor any torque."""
        return self._voltage == self.state.current == self.state.speed == 0.0

    def _hold_shaft(self, step: float) -> MotorState:
        """The state after a step [s] with the shaft held where it is: L di/dt = v - R i, without back-emf."""
        stall = self._voltage / self._physics.resistance
        if self._physics.inductance == 0.0:
            return MotorState(stall, 0.0, self.state.angle)
        left = math.exp(-step * self._physics.resistance / self._physics.inductance)
        return MotorState(stall + (self.state.current - stall) * left, 0.0, self.state.angle)

    def _disturb(self, step: float) -> None:
        """Add what a white torque does to a shaft that slides; one that sticks is held by friction."""
        if not self._rows or self.state.speed == 0.0:
            return
        # One sum after the other, as a block of ticks adds them up; a product of matrices may add in any order.
        current, speed, angle = self.state
        of_current, of_speed, of_angle = self._rows if step == self._tick else self._rows_of_part(step)
        a, b, c = self._random.standard_normal(3).tolist()
        self.state = MotorState(
            current + (of_current[0] * a + of_current[1] * b + of_current[2] * c),
            speed + (of_speed[0] * a + of_speed[1] * b + of_speed[2] * c),
            angle + (of_angle[0] * a + of_angle[1] * b + of_angle[2] * c),
        )

    def factors(self, delay: float) -> tuple[Array, Array]:
        """The parts (N,) into which voltages that act so late [s] cut each tick, in billionths, and their factors (N, 3, 3).

        The first is the whole tick. Each other one has neighbours, as it differs by rounding from tick to tick. N is 0 without a
        random torque.
        """
        if not self._rows:
            return np.empty(0), np.empty((0, 3, 3))
        first = delay % self._tick
        cuts = [
            round(length / (SAME * self._tick)) + beside
            for length in (first, self._tick - first)
            if SAME * self._tick < length < (1 - SAME) * self._tick
            for beside in (0, -1, 1)
        ]
        of_parts = [_rows_of_step(self._physics, self._noise, cut * (SAME * self._tick)) for cut in cuts]
        return np.array([round(1 / SAME), *cuts], dtype=np.float64), np.array([self._rows, *of_parts])

    def _rows_of_part(self, step: float) -> list[list[float]]:
        """The factor's rows for a part of a tick; a delay cuts each tick into the same parts, but for rounding."""
        part = SAME * self._tick
        return _rows_of_step(self._physics, self._noise, round(step / part) * part)


@lru_cache(maxsize=64)
def _rows_of_step(physics: Physics, torque_noise: float, step: float) -> list[list[float]]:
    """The rows of a step's factor [s]; it costs a hundred times as much as what is done with it."""
    rows: list[list[float]] = disturbance_factor(physics, torque_noise, step).tolist()
    return rows

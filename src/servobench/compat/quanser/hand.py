"""The hand that somebody needs for a balance program: it holds the pendulum upright until the motor takes over."""

from __future__ import annotations

import math

from servobench.rig.motor.pendulum import RotaryPendulum

LIFTS_AFTER, LIFTS_FOR = 2.0, 1.0  # s
LETS_GO_AT = 0.1  # V; what a controller puts out that has taken over
TOP = math.radians(179.0)  # nobody holds it exactly upright, and there a controller would have nothing to do
WAITS = 0.3  # s after it has lifted, so that a controller sees a pendulum at rest


class Hand:
    """A hand that holds the pendulum upright from the start, or lifts it after two seconds; it lets go where the motor is driven."""

    def __init__(self, *, lifts: bool) -> None:
        self._begins = LIFTS_AFTER if lifts else -LIFTS_FOR
        self._gone = False

    def move(self, plant: RotaryPendulum, now: float, voltage: float) -> None:
        """Move the rod as the hand does at a time [s], given the voltage at the motor [V]."""
        part = (now - self._begins) / LIFTS_FOR
        if self._gone or part < 0.0:
            return
        if part >= 1.0 and abs(voltage) > LETS_GO_AT and now > self._begins + LIFTS_FOR + WAITS:
            self._gone = True
            plant.release()
            return
        inside = min(part, 1.0)
        # A cubic that starts and ends at rest.
        speed = 6 * inside * (1 - inside) * TOP / LIFTS_FOR
        plant.hold(TOP * inside**2 * (3 - 2 * inside), speed)

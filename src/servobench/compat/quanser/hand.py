"""The hand that a balance program needs: it lifts the pendulum, and lets go once the motor takes over."""

from __future__ import annotations

import math

from servobench.rig.motor.pendulum import RotaryPendulum

LIFTS_AFTER, LIFTS_FOR = 2.0, 3.0  # s
LETS_GO_AT = 0.1  # V; what a controller puts out that has taken over
LETS_GO_ABOVE = math.radians(160.0)  # a controller that balances begins within 10 or 20 degrees of upright
TOP = math.radians(
    179.0
)  # a person doesn't hold it exactly upright; if they did, the controller would have nothing to do


class Hand:
    """A hand that holds the pendulum upright from the start, or lifts it after two seconds; it lets go where the motor is driven.

    It doesn't come where the motor is driven before: that is a program that swings the pendulum up itself.
    """

    def __init__(self, *, lifts: bool) -> None:
        self._begins = LIFTS_AFTER if lifts else -LIFTS_FOR
        self._gone = False

    def move(self, plant: RotaryPendulum, now: float, voltage: float) -> None:
        """Move the rod as the hand does at a time [s], given the voltage at the motor [V]."""
        part = min((now - self._begins) / LIFTS_FOR, 1.0)
        if part < 0.0 and abs(voltage) > LETS_GO_AT:
            self._gone = True
        if self._gone or part < 0.0:
            return
        if plant.pendulum.rod > LETS_GO_ABOVE and abs(voltage) > LETS_GO_AT:
            self._gone = True
            plant.release()
            return
        # A cubic that starts and ends at rest.
        plant.hold(TOP * part**2 * (3 - 2 * part), 6 * part * (1 - part) * TOP / LIFTS_FOR)

"""The watchdog of a virtual board: without a reload in time it puts the outputs to safe states, and keeps them there."""

from __future__ import annotations

import math

from servobench.compat.quanser.enumerations import DigitalState
from servobench.compat.quanser.errors import Code, hil_error


class Watchdog:
    """A board's watchdog: whether it runs, when it expires [s], and the states that the outputs get then."""

    def __init__(self) -> None:
        self.expires = math.inf
        self.expired = False
        self.voltage = 0.0
        self.enabled: int = DigitalState.LOW
        self.lights: tuple[float, ...] = (0.0, 0.0, 1.0)  # blue
        self._timeout = math.inf

    def start(self, timeout: float, now: float) -> None:
        """Let it expire a time [s] from now on, unless it is reloaded."""
        if not (timeout > 0.0 and math.isfinite(timeout)):
            raise hil_error(
                Code.OUT_OF_RANGE, f"the timeout of the watchdog is {timeout!r} s; more than 0 is needed."
            )
        self._timeout = float(timeout)
        self.expires, self.expired = now + self._timeout, False

    def reload(self, now: float) -> bool:
        """Restart the time, and return whether the reload came before it was over."""
        if self.expired:
            return False
        self.expires = now + self._timeout
        return True

    def stop(self) -> None:
        """Let it expire no more; what it did remains until it is cleared."""
        self.expires = self._timeout = math.inf

    def expire(self) -> None:
        """Note that no reload came in time."""
        self.expired, self.expires = True, math.inf

    def clear(self, now: float) -> None:
        """Allow outputs again, and restart the time."""
        self.expired = False
        self.expires = now + self._timeout

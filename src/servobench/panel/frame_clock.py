"""The times of frames: thirty a second, the same for all processes of a machine, by the clock that they share."""

from __future__ import annotations

import math
import time

FRAMES = 30.0  # a second


class FrameClock:
    """Moments that come thirty times a second, `lead` [s] before those of a beat without; those that are missed are left out."""

    def __init__(self, lead: float = 0.0) -> None:
        self._lead = lead
        self._number = 0

    def wait(self) -> float:
        """Return how long it is until the next moment [s], 0 or more; each is returned once, so that none is taken twice."""
        now = time.perf_counter()
        self._number = max(self._number + 1, math.ceil((now + self._lead) * FRAMES))
        return max(self._number / FRAMES - self._lead - now, 0.0)

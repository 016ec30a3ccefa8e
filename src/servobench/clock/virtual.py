"""Time that is computed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

from servobench.channels import Sample, Timing
from servobench.clock.base import Tick


class VirtualClock:
    """Time that passes as fast as it is computed, and is the same to the bit every time: tick k is at k times the sample time."""

    timing: ClassVar[Timing] = "virtual"

    def __init__(self) -> None:
        self._sample_time = math.nan

    def start(self, sample_time: float) -> None:
        """Begin at tick 0."""
        self._sample_time = sample_time

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Latch at once."""
        now = index * self._sample_time
        return Tick(index=index, scheduled=now, actual=now, late=False, sample=read())

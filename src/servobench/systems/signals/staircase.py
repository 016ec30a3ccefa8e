"""Levels one after the other, each held for the same time."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator

from servobench.core.channels import Array
from servobench.core.settings import PositiveTime, Settings, Time
from servobench.systems.signals.base import SIGNALS, Level, at_least_one
from servobench.systems.signals.edges import periods


@SIGNALS.member("staircase")
class Staircase(Settings):
    """The levels in their order, each for `dwell`; the first one also before `start`, the last one without end."""

    levels: Annotated[tuple[Level, ...], AfterValidator(at_least_one)] = (0.0, 1.0, 2.0, 3.0)
    """The levels in their order [V]."""
    dwell: PositiveTime = 2.0
    """Time at each level [s]."""
    start: Time = 0.0
    """Time at which the first level's dwell begins [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        index = np.clip(periods(t, 1 / self.dwell, self.start).whole, 0, len(self.levels) - 1)
        return np.take(np.asarray(self.levels, dtype=float), index.astype(int))

    @property
    def period(self) -> None:
        """There is none: it ends at its last level."""
        return None

    @property
    def shortest_change(self) -> float | None:
        """The time at each level [s]; None where there is one level only."""
        return self.dwell if len(self.levels) > 1 else None

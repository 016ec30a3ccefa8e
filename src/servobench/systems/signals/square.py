"""A square wave."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from servobench.core.channels import Array
from servobench.core.settings import Angle, PositiveFrequency, Settings, Time
from servobench.systems.signals.base import SIGNALS, HighLevel, Level
from servobench.systems.signals.edges import periods


@SIGNALS.member("square")
class Square(Settings):
    """`high` while frac(f (t - start) + phase / 2π) < duty, otherwise `low`; `low` before `start`.

    With phase 0 it is high from `start` on. Edges that fall on a sample are exact: see `edges`.

    >>> import numpy as np
    >>> Square(low=1, high=3, frequency="1 Hz")(np.array([0.0, 0.5]))
    array([3., 1.])
    """

    low: Level = 1.0
    """Lower value [V]."""
    high: HighLevel = 3.0
    """Upper value [V]."""
    frequency: PositiveFrequency = 0.4
    """Periods in a second [Hz]."""
    phase: Angle = 0.0
    """How far into its period the wave is at `start`; a period is 360 deg [rad]."""
    duty: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] = 0.5
    """Fraction of the period at `high`, from 0 to 1."""
    start: Time = 0.0
    """Time at which the wave begins [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        at = periods(t, self.frequency, self.start, self.phase)
        return np.where(at.started & at.before(self.duty), self.high, self.low)

    @property
    def period(self) -> float:
        """The inverse of the frequency [s]."""
        return 1 / self.frequency

    @property
    def shortest_change(self) -> float | None:
        """The shorter of the times at `high` and at `low` [s]; None for a duty of 0 or 1."""
        return min(self.duty, 1 - self.duty) * self.period or None

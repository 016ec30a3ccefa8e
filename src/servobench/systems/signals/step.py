"""A step from one value to another."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.settings import Settings, Time
from servobench.systems.signals.base import SIGNALS, Level
from servobench.systems.signals.edges import is_past


@SIGNALS.member("step")
class Step(Settings):
    """`initial` before `start`, `final` from then on.

    >>> import numpy as np
    >>> Step(final="3 V", start=0.1)(np.array([0.0, 0.1]))
    array([0., 3.])
    """

    initial: Level = 0.0
    """Value before the step [V]."""
    final: Level = 1.0
    """Value from the step on [V]."""
    start: Time = 0.0
    """Time of the step [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        return np.where(is_past(t, self.start), self.final, self.initial)

    @property
    def period(self) -> None:
        """There is none."""
        return None

    @property
    def shortest_change(self) -> None:
        """There is none: it changes once."""
        return None

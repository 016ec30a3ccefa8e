"""A constant."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.settings import Settings
from servobench.systems.signals.base import SIGNALS, Level


@SIGNALS.member("constant")
class Constant(Settings):
    """x(t) = value, at all times.

    >>> import numpy as np
    >>> Constant(value=2)(np.array([0.0, 1.0]))
    array([2., 2.])
    """

    value: Level = 1.0
    """The value [V]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        return np.full(np.shape(t), self.value)

    @property
    def period(self) -> None:
        """There is none: any time would do."""
        return None

    @property
    def shortest_change(self) -> None:
        """There is none: it never changes."""
        return None

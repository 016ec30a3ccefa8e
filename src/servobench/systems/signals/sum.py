"""A sum of signals."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from servobench.core.channels import Array
from servobench.core.settings import Settings
from servobench.systems.signals.base import SIGNALS, AnySignal, at_least_one
from servobench.systems.signals.constant import Constant

_MOST_PERIODS = 1000


@SIGNALS.member("sum")
class Sum(Settings):
    """The sum of its parts at each time, each with its own start."""

    parts: Annotated[
        tuple[AnySignal, ...],
        AfterValidator(at_least_one),
        Field(examples=[[{"type": "square"}, {"type": "sine", "frequency": "1 Hz"}]]),
    ]
    """The signals that are added."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        return np.asarray(np.sum([part(t) for part in self.parts], axis=0))

    @property
    def period(self) -> float | None:
        """The least common multiple of the parts' periods [s]; None where a part has none, or it is over a thousand of them."""
        common: float | None = None
        # Each period is computed once, as a part may be a sum itself.
        for period in [part.period for part in self.parts if not isinstance(part, Constant)]:
            if period is None:
                return None
            common = period if common is None else _common_multiple(common, period)
            if common is None:
                return None
        return common

    @property
    def shortest_change(self) -> float | None:
        """The shortest of the parts' [s]."""
        return min(filter(None, [part.shortest_change for part in self.parts]), default=None)


def _common_multiple(a: float, b: float) -> float | None:
    """The least common multiple of two times, None where their ratio is no ratio of whole numbers up to a thousand."""
    ratio = Fraction(a / b).limit_denominator(_MOST_PERIODS)
    # Periods are inverses of frequencies or products, so a ratio meant to be rational is so to a few roundings.
    if ratio.numerator > _MOST_PERIODS or not math.isclose(ratio, a / b, rel_tol=1e-12):
        return None
    return a * ratio.denominator

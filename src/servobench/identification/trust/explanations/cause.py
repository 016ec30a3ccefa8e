"""A possible cause of a bad fit, before the trial."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from servobench.core.finding import Finding
from servobench.recordings.measurement.dataset import Dataset


@dataclass(frozen=True, kw_only=True, eq=False)
class CauseFit:
    """A cause that fits: its finding, the misfit that is left, and how many numbers it had to choose (`chosen`).

    `structural` is a cause that lies in the motor, so that a richer structure or the intervals may hold it; the others lie in the
    record.
    `change` is by how much the gain of other inputs differs from the one fitted, at most, as a part of that, where it is known:
    the gain's interval may allow for it already.
    What a fit has to bear it out with is `remedy`, which takes the cause out of a record, or the name of a `structure` that has
    it; without either the equation's word is enough.
    """

    finding: Finding
    misfit: float
    chosen: int = 1
    structural: bool = False
    change: float = math.inf
    remedy: Callable[[Dataset], Dataset] | None = None
    structure: str = ""

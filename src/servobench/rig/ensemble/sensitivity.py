"""The sensitivity to tolerances: the effect of each parameter alone, at either end of its tolerance, on an outcome."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.rig.ensemble.tolerances import Tolerance


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """The effect of one parameter's tolerance on one outcome, the others at their nominal values.

    `low` and `high` are the outcome with the parameter at the lower and at the upper end of its tolerance. `share` is the part of
    the outcome's variance that it makes, of all tolerances together, by a straight line between the two ends:
    share_i = (high_i - low_i)² / Σ (high_j - low_j)²; parameters that are independent and evenly spread have variances in that
    proportion (JCGM 100:2008, 5.1.2). NaN where the outcome isn't known, or nothing moves it.
    """

    outcome: str
    parameter: str
    low: float
    high: float
    share: float

    @property
    def effect(self) -> float:
        """The change of the outcome over half of the tolerance: half of the difference between its ends."""
        return 0.5 * (self.high - self.low)


def ends_of(values: Mapping[str, float], tolerances: Sequence[Tolerance]) -> dict[str, Array]:
    """Return the parameters of 1 + 2 T motors: the nominal one, then for each tolerance its lower and its upper end."""
    count = 1 + 2 * len(tolerances)
    parameters = {name: np.full(count, value) for name, value in values.items()}
    for number, each in enumerate(tolerances):
        parameters[each.name][1 + 2 * number] -= each.half
        parameters[each.name][2 + 2 * number] += each.half
    return parameters


def sensitivities(tolerances: Sequence[Tolerance], outcomes: Mapping[str, Array]) -> tuple[Sensitivity, ...]:
    """Return the sensitivities of each outcome, the strongest first; `outcomes` are those of the motors of `ends_of`."""
    ranking = []
    for name, values in outcomes.items():
        low, high = values[1::2], values[2::2]
        squares = (high - low) ** 2
        known = squares[np.isfinite(squares)].sum()
        rows = [
            Sensitivity(
                outcome=name,
                parameter=each.name,
                low=float(low[number]),
                high=float(high[number]),
                share=float(squares[number] / known) if known > 0 else float("nan"),
            )
            for number, each in enumerate(tolerances)
        ]
        ranking += sorted(rows, key=lambda row: -abs(np.nan_to_num(row.effect)))
    return tuple(ranking)

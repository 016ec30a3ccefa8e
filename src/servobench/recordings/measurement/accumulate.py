"""The stage `accumulate`: the position of a shaft whose rows hold the counts since the row before."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, warning
from servobench.core.rounding import count_text
from servobench.recordings.measurement.base import STAGES, Kind
from servobench.recordings.measurement.column import Column

_LOST = 1.5  # sample times between rows: one is missing, and its counts with it


@STAGES.member("accumulate")
@dataclass(frozen=True)
class Accumulate:
    """The position y[k] = x[0] + ... + x[k] of a counter that is read and set back to zero in each row.

    For whole counts that is exact, and follows from what such a row holds, x[k] = y[k] - y[k-1]. Not linear, as `unwrap` isn't:
    it belongs before all else, and a prediction doesn't go through it, as the position is what the motor's model predicts.
    """

    linear: ClassVar[bool] = False
    examples: ClassVar[tuple[str, ...]] = ("accumulate",)

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage; it takes no arguments."""
        if arguments:
            raise UsageError(
                f"`accumulate {' '.join(arguments)}`: `accumulate` takes no settings; join stages with `|`"
            )
        return cls()

    @property
    def symbol(self) -> tuple[str, ...]:
        """A sum, for a diagram."""
        return ("Σ",)

    def yields(self, kind: Kind) -> Kind:
        """A position, of what is in a unit of position: the way since the row before."""
        if kind != "position":
            raise UsageError(
                "`accumulate` needs counts since the row before, in `counts`; a speed has another unit"
            )
        return kind

    def first_valid(self, first: int, t: Array) -> int:
        """The first valid input gives the first valid output."""
        return first

    def start_response(self, t: Array) -> None:
        """Not linear."""
        return None

    def start(self) -> float:
        """Nothing is added up yet."""
        return 0.0

    def step(self, state: float, x: float, dt: float) -> tuple[float, float]:
        """One sample; the state is the sum so far."""
        return state + x, state + x

    def block(self, state: float, x: Array, dt: Array) -> tuple[float, Array]:
        """A block of samples (N,), N at least 1."""
        y = np.cumsum(np.concatenate(([state], x)))[1:]
        return float(y[-1]), y

    def __call__(self, x: Array, t: Array) -> Array:
        """All samples at once."""
        return np.cumsum(x, axis=0)

    def __str__(self) -> str:
        return "accumulate"


def accumulate_counts(column: Column, stage: Accumulate) -> tuple[Column, list[Finding]]:
    """Return the position of a column that holds what was counted since the row before, and a doubt where rows are missing."""
    steps = np.diff(column.t)
    gaps = 1 + np.flatnonzero(steps > _LOST * np.median(steps)) if len(steps) else steps
    position = replace(column, x=stage(column.x, column.t))
    if not len(gaps):
        return position, []
    row = int(column.rows[gaps[0]])
    sentence = (
        f"{column.name!r} holds the counts since the row before, and rows are missing in {count_text(len(gaps), 'place')}, first "
        f"before row {row}: what was counted there isn't in the position. Use the part before, or record the counter's total."
    )
    return position, [warning("counts-lost", sentence, rows=(row, int(column.rows[gaps[-1]])))]

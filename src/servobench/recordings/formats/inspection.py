"""Statistics of a recording's samples: the spacing of their times, and how long a channel is at the ends of its range."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array, measurable
from servobench.recordings.formats.roles import quantity_of
from servobench.recordings.formats.times import GAP
from servobench.recordings.recording import Series

_EVEN = 1e-6  # of the median: steps that differ by less are equal but for rounding
_BINS = 40
_LEVELS = 10  # a signal of fewer levels is a step or a staircase, which may well stay at its ends
_RUN = 5  # samples one after the other


@dataclass(frozen=True, kw_only=True, eq=False)
class Intervals:
    """A histogram of sample intervals: `counts` (B,) between `edges` (B + 1,) [s], and the number beyond.

    `median` is in s. Only intervals that go forward are counted; `beyond` are gaps, longer than `GAP` medians.
    """

    edges: Array
    counts: NDArray[np.int64]
    median: float
    beyond: int

    @property
    def is_even(self) -> bool:
        """Whether all intervals are equal but for rounding."""
        return len(self.counts) == 1 and not self.beyond


def _finite(x: Array) -> Array:
    """The values (N,) that a channel can have."""
    x = measurable(x)
    return x[np.isfinite(x)]


def intervals(t: Array) -> Intervals | None:
    """Return how the intervals between times t (N,) [s] are spread; None where no time is later than another."""
    steps = np.diff(_finite(t))
    steps = steps[np.isfinite(steps) & (steps > 0)]
    if not len(steps):
        return None
    median = float(np.median(steps))
    near = steps[steps <= GAP * median]
    low, high = float(near.min()), float(near.max())
    if high - low <= _EVEN * median:
        edges = np.array([0.95 * median, 1.05 * median])
        return Intervals(
            edges=edges, counts=np.array([len(near)]), median=median, beyond=len(steps) - len(near)
        )
    counts, edges = np.histogram(near, _BINS, (low, high))
    return Intervals(edges=edges, counts=counts, median=median, beyond=len(steps) - len(near))


@dataclass(frozen=True, kw_only=True)
class Extremes:
    """The share of samples at the ends of a channel's range.

    `smallest` and `largest` are in its unit, `at_smallest` and `at_largest` shares of the samples, `longest` the longest stay at
    either end in samples. `looks_limited` says that a signal of many levels stays there on its way, and longer than anywhere
    else, as one does that a limit cuts off; a position rests where the motor stands, and is never said to be.
    """

    smallest: float
    largest: float
    at_smallest: float
    at_largest: float
    longest: int
    looks_limited: bool


def extremes(series: Series) -> Extremes | None:
    """Return how long a channel sits at its ends; None where it has no finite value, or never changes."""
    values = _finite(series.values)
    if not len(values) or values.min() == values.max():
        return None
    low, high = float(values.min()), float(values.max())
    starts = np.flatnonzero(np.diff(values, prepend=np.nan) != 0)
    lengths = np.diff(np.append(starts, len(values)))
    at_end = np.isin(values[starts], (low, high))
    between = np.ones(len(starts), dtype=np.bool_)
    between[[0, -1]] = (
        False  # before it begins to move and after it has stopped, a channel rests at an end of its range
    )
    between &= values[starts] != 0  # what is zero is off, or at rest
    cut = int(lengths[at_end & between].max(initial=0))
    elsewhere = int(lengths[~at_end].max(initial=0))
    return Extremes(
        smallest=low,
        largest=high,
        at_smallest=float(np.mean(values == low)),
        at_largest=float(np.mean(values == high)),
        longest=int(lengths[at_end].max()),
        looks_limited=quantity_of(series.channel.unit) != "position"
        and len(np.unique(values)) > _LEVELS
        and cut >= _RUN
        and cut > 2 * elsewhere,
    )

"""The exponential average of a differenced speed that nobody named, found in the speed itself.

    y[k] = β y[k-1] + (1 - β) x[k],   x[k] = Q n[k]/(t[k] - t[k-1]),   n whole numbers of counts Q

Where n and the time between rows repeat, as they do at a steady speed, the differences of y shrink by β from row to row: the
ratio that occurs far more often than its neighbours is β. What is left open of it is settled by the whole numbers: where y
changes least they don't hang on β, and give Q; then each row whose n is beyond doubt says more of β than those before.

It follows from the definition of the average (Brown 1959), which is that of `measurement.ema`; the search between roundings is
that of an unwrapped phase.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array

_SHORTEST, _LONGEST = 0.02, 0.98  # of β: less is no average, and more leaves no digit of a count
_WIDTH = 0.005  # of β, in which ratios are alike
_FEWEST = 8  # ratios that are alike
_TIMES = 3.0  # as many as in the windows beside it
# What is left by weights as sketches have them: 0.5, 0.4 ... 0.05.
_USUAL = (0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.875, 0.9, 0.95)
_CANDIDATES = 3
_QUIET = 0.25  # of the rows, those in which the speed changes least
_SURE = 0.2  # of a count, that a row may be off at most
_SDS = 4.0  # standard deviations, within which β surely is
_ROUNDS = 12
_ROUNDING = 1e-9  # of the range


def decays(y: Array, dt: Array, step_of: Callable[[Array], float | None]) -> Iterator[tuple[float, float]]:
    """Yield what may be left of a speed y (N,) from row to row, β, with the quantum that goes with it, the likeliest first.

    `dt` (N - 1,) are the times between rows [s], and `step_of` says the quantum that increments (M,) are multiples of.
    """
    frequent = _frequent_ratios(np.diff(y))
    usual = (each for each in _USUAL if all(abs(each - other) > _WIDTH for other in frequent))
    changes = np.abs(np.diff(y)) * dt
    quiet = changes <= np.quantile(changes, _QUIET)
    for first in (*frequent, *usual):
        increments = _increments(first, y, dt)[quiet]
        # With all of a float's digits the increments are a grid as they are; what a print rounds is one about its centres.
        for quantum in (step_of(increments), step_of(_centres(increments))):
            if quantum is not None and (refined := _refine(first, quantum, y, dt)) is not None:
                yield refined, quantum


def _frequent_ratios(differences: Array) -> list[float]:
    """The ratios of neighbouring differences (N,) that occur far more often than those beside them."""
    before, after = differences[:-1], differences[1:]
    large = np.abs(before) > _ROUNDING * np.abs(differences).max(initial=0.0)
    ratios = np.sort(after[large] / before[large])
    ratios = ratios[(ratios > _SHORTEST) & (ratios < _LONGEST)]
    frequent: list[float] = []
    for _ in range(_CANDIDATES):
        count = _within(ratios, ratios, 0.5 * _WIDTH)
        if not len(count) or count.max() < _FEWEST:
            break
        best = float(ratios[np.argmax(count)])
        wide = int(_within(ratios, np.array([best]), 2.5 * _WIDTH)[0])
        alike = int(count.max())
        if alike > _TIMES * (wide - alike) / 4.0:
            frequent.append(float(np.median(ratios[np.abs(ratios - best) <= 0.5 * _WIDTH])))
        ratios = ratios[np.abs(ratios - best) > 2.5 * _WIDTH]
    return frequent


def _within(ordered: Array, centres: Array, half: float) -> NDArray[np.int64]:
    """How many of the values (N,), in order, lie within `half` of each centre (M,)."""
    ends = np.searchsorted(ordered, centres + half, "right")
    return np.asarray(ends - np.searchsorted(ordered, centres - half, "left"), dtype=np.int64)


def _refine(decay: float, quantum: float, y: Array, dt: Array) -> float | None:
    """The decay near a first one with which rows are whole numbers of a quantum; None where no row says more than is known."""
    changes = np.diff(y) * dt
    open_by = _WIDTH
    for _ in range(_ROUNDS):
        counts = _increments(decay, y, dt) / quantum
        slope = changes / (1.0 - decay) ** 2 / quantum  # counts by β
        off = counts - np.rint(counts)
        sure = (np.abs(slope) * open_by < _SURE) & (np.abs(off) < _SURE)
        power = float(slope[sure] @ slope[sure])
        if sure.sum() < _FEWEST or power == 0.0:
            return None
        decay -= float(slope[sure] @ off[sure]) / power
        if not _SHORTEST < decay < _LONGEST:
            return None
        open_by = max(_SDS * float(np.sqrt(np.mean(off[sure] ** 2) / power)), _ROUNDING)
    return decay


def _centres(x: Array) -> Array:
    """The mean of those that lie close for each of x (N,), in order; their distances are those below the largest break."""
    values = np.sort(x)
    distances = np.sort(np.diff(values))
    distances = distances[distances > _ROUNDING * np.ptp(values)]
    if len(distances) < 2:
        return values
    at = int(np.argmax(distances[1:] / distances[:-1]))
    group = np.concatenate(
        [[0], np.cumsum(np.diff(values) > np.sqrt(distances[at]) * np.sqrt(distances[at + 1]))]
    )
    return np.asarray((np.bincount(group, values) / np.bincount(group))[group])


def _increments(decay: float, y: Array, dt: Array) -> Array:
    """What was averaged (N - 1,), times the time that it is of."""
    return np.asarray((y[1:] - decay * y[:-1]) / (1.0 - decay) * dt)

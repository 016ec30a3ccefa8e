"""Errors that repeat with the input: folding a record on the input's period.

If a motor repeats the same motion, it comes back to the same counts, and the encoder's rounding repeats too. It then averages
out within a period but not over the periods, as the usual covariance assumes. Scores that are first summed over the periods
show this. Missing rows, or slightly scattered times, don't matter: each sample has its place on an even grid of times, and is
compared with the sample a period earlier, if there is one. (Clustered scores: Liang and Zeger 1986; when they are used:
docs/decisions/0006-intervals.md.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

_PROBES = 32
_SAME = 1e-9  # of the input's range
_REPEATS = 0.6  # correlation of the residual with itself a period before; chance gives 0.014 in 5,000 samples
_FIRST = (
    4  # changes of the input from which its period is measured: one of them may have come in a missing row
)
_ALIKE_IN_LENGTH = 0.9  # of the longer stretch
_MET = 0.1  # of the samples have to meet one a period before; half of them do in two whole periods


Samples: TypeAlias = NDArray[np.int64] | slice


@dataclass(frozen=True, eq=False)
class Cycle:
    """The `places` (M,) of samples on an even grid of times, counted from the first, and the `length` of the period there."""

    places: NDArray[np.int64]
    length: int

    @cached_property
    def pairs(self) -> tuple[Samples, Samples]:
        """Return the samples that have one a period before them, and those."""
        from servobench.identification.estimators import kernels

        if (self.places == np.arange(len(self.places))).all():  # nothing is missing
            return slice(self.length, None), slice(None, -self.length)
        now = kernels.find_places(self.places, self.places + self.length)
        before = np.flatnonzero(now >= 0)
        return now[before], before


@keep_with_data
def period(data: Dataset) -> Cycle | None:
    """Return after how much of a record's even grid its input repeats, twice at least; None where it doesn't."""
    from servobench.identification.estimators import kernels

    if len(data.t_output) < 4:
        return None
    u = _input(data)
    spread = float(np.ptp(u))
    if spread == 0:
        return None
    places = kernels.places_on_a_grid(data.t_output, data.sample_time)
    half = (int(places[-1]) + 1) // 2
    near = _SAME * spread
    for shift in _alike(u, places, _shifts(u, places, half, near), near):
        cycle = Cycle(places, int(shift))
        now, before = cycle.pairs
        change = u[now] - u[before]
        if len(change) >= _MET * len(u) and np.abs(change).max() <= near:
            return cycle
    return None


def repeats(residual: Array, cycle: Cycle) -> bool:
    """Return whether a residual (M,) is alike in successive periods."""
    later, earlier = cycle.pairs
    now, before = residual[later], residual[earlier]
    power = float(np.sqrt(np.sum(now**2) * np.sum(before**2)))
    return power > 0 and float(now @ before) > _REPEATS * power


def stretches_repeat(data: Sequence[Dataset], residuals: Sequence[Array]) -> bool:
    """Return whether the stretches of one recording repeat: most of them have a residual like that of another one.

    They are compared from their first samples on. That is for stretches that begin in the same way, as those that a jump sets off
    do; those that go the other way are the mirror image of the first, to which no encoder's rounding is bound.
    """
    alike = 0
    for n, (one, residual) in enumerate(zip(data, residuals, strict=True)):
        others = (
            other
            for m, (record, other) in enumerate(zip(data, residuals, strict=True))
            if m != n and record.source is one.source
        )
        alike += any(_alike_from_start(residual, other) for other in others)
    return alike > 0.5 * len(data)


def _alike_from_start(one: Array, other: Array) -> bool:
    """Whether two residuals are alike over the length of the shorter one, of nearly the same length."""
    size = min(len(one), len(other))
    if size < _ALIKE_IN_LENGTH * max(len(one), len(other)):
        return False
    now, before = one[:size], other[:size]
    power = float(np.sqrt(np.sum(now**2) * np.sum(before**2)))
    return power > 0 and float(now @ before) > _REPEATS * power


def fold(scores: Array, cycle: Cycle) -> Array:
    """Return scores (M, P) summed over the periods, a row for each place in the period of which there is a sample."""
    from servobench.identification.estimators import kernels

    out = np.zeros((cycle.length, scores.shape[1]))
    met = np.zeros(cycle.length, dtype=bool)
    kernels.add_cycles(scores, cycle.places, out, met)
    return out if met.all() else out[met]


def _input(data: Dataset) -> Array:
    """The input that holds from each sample of the output on, (M,); a time a thousandth of a step later is the same time."""
    from servobench.identification.estimators import kernels

    index = kernels.latest(data.t_input, data.t_output + 1e-3 * data.sample_time)
    return np.where(index >= 0, data.u[np.maximum(index, 0)], data.input_before)


def _shifts(u: Array, places: NDArray[np.int64], half: int, near: float) -> NDArray[np.int64]:
    """The periods that may be: of a held input the distances of two changes, of one that always changes any."""
    changes = np.flatnonzero(np.abs(np.diff(u)) > near)
    if len(changes) >= len(u) // 4:
        return np.arange(1, min(half, len(u)) + 1)
    at = places[changes + 1]
    shifts = np.unique(at[None, :] - at[:_FIRST, None])
    return np.asarray(shifts[(shifts > 0) & (shifts <= half)], dtype=np.int64)


def _alike(u: Array, places: NDArray[np.int64], shifts: NDArray[np.int64], near: float) -> NDArray[np.int64]:
    """Those of the shifts after which a few samples of the input are as they were, as far as there are any."""
    last = int(np.searchsorted(places, places[-1] - (places[-1] + 1) // 2, side="right")) - 1
    probes = np.linspace(0, last, _PROBES).astype(int)[:, None]
    later, met = _find_places(places, places[probes] + shifts)
    alike = ((np.abs(u[later] - u[probes]) <= near) | ~met).all(axis=0)
    return np.asarray(shifts[alike], dtype=np.int64)


def _find_places(
    places: NDArray[np.int64], wanted: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The samples at the places that are wanted, and whether there is one."""
    index = np.minimum(np.searchsorted(places, wanted), len(places) - 1)
    return index, places[index] == wanted

"""The margins of a family of sampled loops, such as those of all motors that the data allow, computed together.

The law is that of one loop (source: see `systems.sampled_loop`), in arrays with a row for each loop: six loops take as long as
one by one, 600 a fifteenth of that. A row has NaN in the place of roots and crossings that only other loops have.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.systems.margins import Margins, slopes
from servobench.systems.responses import (
    difference,
    positive_roots_of_each,
    product,
    roots,
    squared_magnitude,
)
from servobench.systems.sampled_loop import EDGE, LEVEL, SampledLoop, margins_and_gain_range

_TURN = 2 * math.pi
_QUARTER = 0.5 * math.pi
_CLOSE = 4 * sys.float_info.epsilon
_FEW = 6  # loops of one form that are computed sooner one by one
_MOST = 200  # steps to a crossing; halving alone takes 60, and interpolation a dozen


def margins_of_family(loops: Sequence[SampledLoop]) -> list[Margins]:
    """Return the margins of each of many loops, as `sampled_loop.sampled_margins` does of one."""
    return [margins for margins, _ in margins_and_gain_ranges(loops)]


def margins_and_gain_ranges(loops: Sequence[SampledLoop]) -> list[tuple[Margins, tuple[float, float]]]:
    """Return margins and range of stable gains of each of many loops, as `sampled_loop.margins_and_gain_range` does of one."""
    alike: dict[tuple[int, int, int], list[int]] = {}
    for n, loop in enumerate(loops):
        leading = next((k for k, c in enumerate(loop.numerator) if c), len(loop.numerator))
        alike.setdefault((leading, len(loop.numerator), len(loop.denominator)), []).append(n)
    result: dict[int, tuple[Margins, tuple[float, float]]] = {}
    for (leading, length, _), rows in alike.items():
        family = [loops[n] for n in rows]
        if leading == length or len(rows) < _FEW:
            result |= {n: margins_and_gain_range(loops[n]) for n in rows}
        else:
            result |= zip(rows, _Family.of(family, leading).margins(), strict=True)
    return [result[n] for n in range(len(loops))]


@dataclass(frozen=True, kw_only=True)
class _Family:
    """Phase and magnitude of M loops z^(-whole) N(w)/D(w) over α = ωh/2, from 0 to π/2, (M, E) at E points α of each."""

    numerator: Array
    denominator: Array
    whole: Array
    sample_time: Array
    zeros: NDArray[np.complex128]
    poles: NDArray[np.complex128]

    @classmethod
    def of(cls, loops: Sequence[SampledLoop], leading: int) -> _Family:
        """The family of loops whose numerators have so many leading zeros."""
        numerator = np.array([loop.numerator[leading:] for loop in loops])
        denominator = np.array([loop.denominator for loop in loops])
        return cls(
            numerator=numerator,
            denominator=denominator,
            whole=np.array([loop.whole for loop in loops], dtype=np.float64)[:, None],
            sample_time=np.array([loop.sample_time for loop in loops])[:, None],
            zeros=roots(numerator),
            poles=roots(denominator),
        )

    def take(self, rows: NDArray[np.intp]) -> _Family:
        """The loops of these rows, each as often as it is among them."""
        return _Family(**{name: values[rows] for name, values in vars(self).items()})

    def turns(self, alpha: Array) -> Array:
        """The turns by which the phase is above -180°; that of jω - r has no jump for a root r on the right, too."""
        v = np.tan(alpha)
        angle = math.pi * (1.0 + (self.numerator[:, :1] * np.sign(self.denominator[:, :1]) < 0))
        angle = angle - 2 * self.whole * alpha
        for places, sense in ((self.zeros, 1.0), (self.poles, -1.0)):
            for root in places.T[:, :, None]:
                left = np.arctan2(v - root.imag, np.abs(root.real))
                angle += sense * np.where(root.real <= 0, left, math.pi - left)
        return angle / _TURN

    def factor(self, alpha: Array) -> Array:
        """1/|L|."""
        w = 1j * np.tan(alpha)
        above, below = (np.abs(_values(each, w)) for each in (self.numerator, self.denominator))
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(above > 0, below / above, np.where(np.isnan(above), np.nan, np.inf))

    def margins(self) -> list[tuple[Margins, tuple[float, float]]]:
        """The margins of each loop, and the factors on its gain, below and above 1, that end its stability."""
        n, d = squared_magnitude(self.numerator), squared_magnitude(self.denominator)
        crossovers = np.sqrt(positive_roots_of_each(difference(n, d)))
        factor, alpha = self._at_half_turns(crossovers)
        with np.errstate(invalid="ignore", divide="ignore"):
            below = np.max(np.where(factor < 1, factor, 0.0), axis=1)
            above = np.min(np.where(factor >= 1, factor, np.inf), axis=1)
            apart = np.minimum(np.abs(np.log(factor)), sys.float_info.max)
        columns = self._of_the_phase(crossovers) | {
            "gain_margin": _at_least(apart, factor, math.inf),
            "phase_crossover": _at_least(apart, 2 * alpha / self.sample_time, math.nan),
        }
        rows = np.stack([below, above, *columns.values()], axis=1).tolist()
        return [(Margins(**dict(zip(columns, row, strict=True))), (low, high)) for low, high, *row in rows]

    def _of_the_phase(self, crossovers: Array) -> dict[str, Array]:
        """Phase and delay margin and the gain crossover of each loop, by all its gain crossovers [v]."""
        turns = self.turns(np.arctan(crossovers))
        left = _TURN * (turns - np.ceil(turns - 0.5))  # within (-π, π]
        omega = 2 * np.arctan(crossovers) / self.sample_time
        delay = np.maximum(left, 0.0) / omega
        middle = self.factor(np.full((len(omega), 1), 0.5 * _QUARTER))[:, 0]
        return {
            "phase_margin": _at_least(np.abs(left), left, math.inf),
            "delay_margin": _at_least(delay, delay, math.inf),
            "gain_crossover": _at_least(np.abs(left), omega, np.where(middle < 1, np.inf, np.nan)),
        }

    def _at_half_turns(self, crossovers: Array) -> tuple[Array, Array]:
        """The points of phase -180° that may be the nearest to |L| = 1 of each loop: 1/|L| and α."""
        edges = np.arctan(np.concatenate([crossovers, self._turning_points()], axis=1))
        edges.sort(axis=1)  # NaN last
        turns = self.turns(edges)
        with np.errstate(invalid="ignore"):
            at_edges = np.where(np.abs(turns - np.rint(turns)) < LEVEL, edges, np.nan)
        between = self._between(np.where(np.isnan(edges), _QUARTER, edges))
        inner = np.concatenate([at_edges, between], axis=1)
        factor_at_ends, ends = self._at_the_ends()
        return (
            np.concatenate([factor_at_ends, self.factor(inner)], axis=1),
            np.concatenate([ends, inner], axis=1),
        )

    def _turning_points(self) -> Array:
        """The points at which phase or magnitude stop rising or falling, or jump [v]."""
        phase, magnitude, squared = slopes(self.numerator, self.denominator)
        held = difference(product(phase, np.array([1.0, 1.0])), 2.0 * self.whole * squared)
        both = np.concatenate([self.zeros, self.poles], axis=1)
        jumps = (both.imag != 0) & (np.abs(both.real) <= LEVEL * np.abs(both.imag))
        turning = [positive_roots_of_each(each) for each in (held, magnitude) if each.shape[1]]
        return np.concatenate([*map(np.sqrt, turning), np.where(jumps, np.abs(both.imag), np.nan)], axis=1)

    def _at_the_ends(self) -> tuple[Array, Array]:
        """The gain factors at which a root of the closed loop passes z = 1 or z = -1, as `sampled_loop` has them, and α."""
        n, d = self.numerator[:, [-1, 0]], self.denominator[:, [-1, 0]]
        n = n * np.concatenate([np.ones_like(self.whole), (-1.0) ** self.whole], axis=1)
        negative = n * d < 0
        if self.numerator.shape != self.denominator.shape:
            negative[:, 1] = False
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.where(negative, np.abs(d / n), np.nan)
        return factor, np.where(negative, np.array([0.0, _QUARTER]), np.nan)

    def _between(self, edges: Array) -> Array:
        """α on each stretch between the edges (M, E), (M, E + 1): of the levels crossed the one where |L| is nearest to 1."""
        low = np.pad(edges, ((0, 0), (1, 0)))
        high = np.pad(edges, ((0, 0), (0, 1)), constant_values=_QUARTER)
        start, end = low + EDGE * np.where(low == 0, high, low), high * (1 - EDGE)
        first, last = self.turns(start), self.turns(end)
        least = np.ceil(np.minimum(first, last) + LEVEL)
        most = np.floor(np.maximum(first, last) - LEVEL)
        with np.errstate(divide="ignore"):
            nearer = np.abs(np.log(self.factor(start))) < np.abs(np.log(self.factor(end)))
        level = np.where((first < last) ^ ((most > least) & ~nearer), least, most)
        rows, columns = np.nonzero((high > low) & (most >= least))
        part, level = self.take(rows), level[rows, columns]
        at = np.full(low.shape, np.nan)
        at[rows, columns] = _crossings(
            lambda alpha: part.turns(alpha[:, None])[:, 0] - level, start[rows, columns], end[rows, columns]
        )
        return at


def _values(polynomials: Array, w: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """P(w) of polynomials (M, n + 1) at points (M, E)."""
    total = np.zeros_like(w)
    for coefficients in polynomials.T:
        total = total * w + coefficients[:, None]
    return total


def _at_least(by: Array, values: Array, default: Any) -> Array:
    """The values (M,) of (M, K) in the place where another row is least; the default where that has NaN only."""
    without = np.isnan(by)
    if not by.shape[1]:
        return np.full(len(by), default)
    place = np.argmin(np.where(without, np.inf, by), axis=1)[:, None]
    return np.where(without.all(axis=1), default, np.take_along_axis(values, place, axis=1)[:, 0])


def _crossings(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Where a function (K,) of K variables crosses zero, each between its two ends, as `core.crossing` does of one."""
    last, other = low, high
    at_last, at_other = function(last), function(other)
    share = np.full(len(low), 0.5)
    for _ in range(_MOST):
        near = _CLOSE * np.abs(np.where(np.abs(at_last) < np.abs(at_other), last, other)) + sys.float_info.min
        length = np.abs(other - last)
        ready = (at_last == 0) | (at_other == 0) | (length <= 2 * near)
        if ready.all():
            break
        least = near / np.maximum(length, near)
        new = last + np.where(ready, 0.0, np.clip(share, least, 1 - least)) * (other - last)
        at_new = function(new)
        same = np.signbit(at_new) == np.signbit(at_last)
        before, at_before = np.where(same, last, other), np.where(same, at_last, at_other)
        other, at_other = np.where(same, other, last), np.where(same, at_other, at_last)
        last, at_last = new, at_new
        share = _shares(last, at_last, other, at_other, before, at_before)
    return np.where(np.abs(at_last) < np.abs(at_other), last, other)


def _shares(a: Array, at_a: Array, b: Array, at_b: Array, c: Array, at_c: Array) -> Array:
    """How far along the way from a to b inverse quadratic interpolation puts the zero; a half where it can't be relied on."""
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = (a - b) / (c - b), (at_a - at_b) / (at_c - at_b)
        reliable = (1 - np.sqrt(1 - x) < y) & (y < np.sqrt(x))
        share = at_a / (at_b - at_a) * at_c / (at_b - at_c)
        share += (c - a) / (b - a) * at_a / (at_c - at_a) * at_b / (at_c - at_b)
    return np.where(reliable, share, 0.5)

"""The root locus: where the poles of a closed loop go as the gain of its controller grows, and for which gains it is stable.

1 + k L(s) = 0,  L = N/D,  so that the closed loop's poles are the roots of D + k N (Evans 1948).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.systems.stability.gains import balance_gain, closed_polynomial, stable_gains
from servobench.systems.transfer_function import TransferFunction

_GAINS = 400  # of a locus, where none are given
_DECADES = 3.0  # on either side of the gain at which N and D weigh the same


@dataclass(frozen=True, kw_only=True, eq=False)
class RootLocus:
    """The poles (G, n) [1/s] of the closed loop for gains (G,), a branch in each column; where branches meet, and where they go.

    `meetings` are the gains and places at which branches meet on the real axis; `centroid` and `angles` [rad] are those of
    the asymptotes, `stable` the gains above zero for which the loop is stable, each (from, to).
    """

    gains: Array
    poles: NDArray[np.complex128]
    meetings: tuple[tuple[float, float], ...]
    centroid: float
    angles: tuple[float, ...]
    stable: tuple[tuple[float, float], ...]


def root_locus(loop: TransferFunction, gains: Sequence[float] | Array | None = None) -> RootLocus:
    """Return the root locus of a rational open loop L, with negative feedback and gains from 0 on.

    Raises `UsageError` for a loop with a delay, whose closed loop has infinitely many poles (`closed_loop` judges it all the
    same), and for one whose numerator is of higher order than its denominator.
    """
    n, d = _parts(loop)
    chosen = _gains(n, d) if gains is None else np.asarray(gains, dtype=np.float64)
    if chosen.ndim != 1 or not len(chosen) or not np.isfinite(chosen).all():
        raise UsageError(
            f"root locus: gains of shape {chosen.shape}; expected finite numbers, one after the other"
        )
    branches = [np.asarray(np.roots(closed_polynomial(n, d, float(k))), dtype=np.complex128) for k in chosen]
    if len({len(each) for each in branches}) > 1:
        raise UsageError(
            "root locus: at one of the gains the leading coefficients cancel and a pole is lost; leave that gain out"
        )
    for row in range(1, len(branches)):
        branches[row] = _in_order(branches[row - 1], branches[row])
    poles, zeros = np.roots(d), np.roots(n)
    excess = len(poles) - len(zeros)
    return RootLocus(
        gains=chosen,
        poles=np.array(branches, dtype=np.complex128),
        meetings=_meetings(n, d),
        centroid=float((poles.sum() - zeros.sum()).real / excess) if excess else math.nan,
        angles=tuple((2 * k + 1) * math.pi / excess for k in range(excess)),
        stable=stable_gains(loop),
    )


def _parts(loop: TransferFunction) -> tuple[Array, Array]:
    if loop.delay:
        raise UsageError(
            f"root locus: the loop has a delay of {loop.delay:g} s, and its closed loop infinitely many poles; "
            "remove the delay, use a Padé approximation (interop.without_delay), or use closed_loop"
        )
    n = np.trim_zeros(np.asarray(loop.numerator, dtype=np.float64), "f")
    d = np.asarray(loop.denominator, dtype=np.float64)
    if not len(n) or len(n) > len(d):
        raise UsageError(f"root locus: {loop}; expected a numerator that isn't zero, of no higher order")
    return n, d


def _gains(n: Array, d: Array) -> Array:
    """Gains from 0 over the range in which the poles move: around that of each coefficient against its counterpart."""
    own = balance_gain(n, d) * np.logspace(-_DECADES, _DECADES, _GAINS)
    met = [k for k, _ in _meetings(n, d)]
    return np.array(sorted({0.0, *own.tolist(), *met}))


def _meetings(n: Array, d: Array) -> tuple[tuple[float, float], ...]:
    """The points at which two branches meet on the real axis: k = -D/N has an extremum there, and is above zero."""
    extremum: Array = np.polysub(np.polymul(np.polyder(d), n), np.polymul(d, np.polyder(n)))
    points = []
    for root in np.roots(extremum):
        if abs(root.imag) > 1e-7 * max(abs(root), 1e-300):
            continue
        at = float(root.real)
        over = float(np.polyval(n, at))
        k = -float(np.polyval(d, at)) / over if over else math.inf
        if 0 < k < math.inf:
            points.append((k, at))
    return tuple(sorted(points))


def _in_order(before: NDArray[np.complex128], now: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Poles in the order of those at the gain before, so that all together have moved least."""
    from scipy.optimize import linear_sum_assignment

    _, order = linear_sum_assignment(np.abs(before[:, None] - now[None, :]) ** 2)
    return np.asarray(now[order], dtype=np.complex128)

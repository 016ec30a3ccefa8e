"""A closed sampled loop: whether it is stable, the gains for which it is, and its bandwidth.

It is stable where all poles z are inside of the unit circle (Franklin, Powell and Workman 1998, chapter 4).
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from servobench.systems.responses import bandwidth
from servobench.systems.sampled_loop import SampledLoop, gain_limits
from servobench.systems.stability.gains import closed_polynomial
from servobench.systems.stability.nyquist import ClosedLoop, judge
from servobench.systems.stability.poles import poles_of
from servobench.systems.stability.verdict import StabilityVerdict

_ON_THE_CIRCLE = 1e-9  # of |z| - 1; eigenvalues are no better where several are close together
_APART = 1e-9  # relative; gains nearer than that are one


def closed_sampled_loop(loop: SampledLoop) -> ClosedLoop:
    """Return whether a sampled loop is stable once it is closed; `right` counts poles outside the unit circle."""
    open_right = sum(pole.multiplicity for pole in poles_of(loop.denominator) if pole.side > 0)
    outside, verdict = _outside(loop, 1.0)
    if verdict == "marginally stable":
        return ClosedLoop(
            verdict=verdict,
            right=None,
            open_right=open_right,
            encirclements=None,
            sentence="The closed loop has a pole on the unit circle: it is on the border of stability.",
        )
    return judge(verdict, outside, open_right, "outside the unit circle")


def stable_sampled_gains(loop: SampledLoop) -> tuple[tuple[float, float], ...]:
    """Return the factors k > 0 with which k L is stable once it is closed, each range as (from, to).

    Poles cross the unit circle at `gain_limits` only; between two of these one factor decides for all.
    """
    limits = [0.0, *sorted(k for k in gain_limits(loop) if 0 < k < math.inf)]
    edges = [k for n, k in enumerate(limits) if not n or k > limits[n - 1] * (1 + _APART)]
    ranges = [
        (low, high)
        for low, high in pairwise([*edges, math.inf])
        if _outside(loop, _between(low, high))[1] == "stable"
    ]
    joined: list[tuple[float, float]] = []
    for low, high in ranges:
        if joined and joined[-1][1] == low and _outside(loop, low)[1] == "stable":
            joined[-1] = (joined[-1][0], high)
        else:
            joined.append((low, high))
    return tuple(joined)


def closed_bandwidth(loop: SampledLoop) -> float:
    """Return where L/(1 + L) has 1/√2 of its gain at zero [rad/s]; infinite where it hasn't up to π/h."""
    open_loop = loop.in_w
    below = closed_polynomial(np.asarray(open_loop.numerator), np.asarray(open_loop.denominator), 1.0)
    v = bandwidth(replace(open_loop, denominator=tuple(map(float, below))))
    return loop.omega(v) if math.isfinite(v) else v


def _between(low: float, high: float) -> float:
    if math.isfinite(high):
        return 0.5 * (low + high)
    return 2 * low if low else 1.0


def _outside(loop: SampledLoop, factor: float) -> tuple[int, StabilityVerdict]:
    """The number of the closed loop's poles outside the unit circle, and the verdict that follows."""
    beyond = np.abs(loop.closed_poles(factor)) - 1
    count = int((beyond > _ON_THE_CIRCLE).sum())
    if count:
        return count, "unstable"
    return 0, "marginally stable" if (beyond >= -_ON_THE_CIRCLE).any() else "stable"

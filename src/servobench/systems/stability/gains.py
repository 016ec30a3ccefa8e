"""All gains for which a closed loop is stable, with its exact delay.

Poles of the closed loop cross the imaginary axis where L(jω) is real and negative, at the gain k = 1/|L(jω)|. The phase of L
tells where: its slope over ω is a ratio of polynomials, so between the roots of a polynomial in ω² it only rises or only falls,
and passes each odd multiple of π there once or not at all. A falling phase brings a pair of poles to the right, a rising one
takes a pair back (Nyquist 1932); at ω = 0 it is one pole. No grid of gains or frequencies has a part in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from servobench.core.channels import Array
from servobench.core.crossing import crossing
from servobench.core.errors import UsageError
from servobench.systems.margins import Phase, turning_points
from servobench.systems.responses import mirror, positive_roots
from servobench.systems.stability.nyquist import closed_loop
from servobench.systems.stability.poles import poles_of
from servobench.systems.stability.verdict import verdict_of
from servobench.systems.transfer_function import TransferFunction

_TURN = 2 * math.pi
_MOST = 100_000  # turns of the delay's phase that are looked through
_APART = 1e-9  # relative; gains nearer than that are one, and nothing is between them
_FIRST = 5e-324  # rad/s; the frequency next to 0, at which an integrator has its phase


@dataclass(frozen=True, kw_only=True)
class _Limit:
    """A gain at which poles cross the imaginary axis, and how many more are to the right beyond it."""

    gain: float
    more: int


def stable_gains(loop: TransferFunction) -> tuple[tuple[float, float], ...]:
    """Return the gains k > 0 for which 1 + k L has all its roots in the left half-plane, each range as (from, to).

    Raises `UsageError` for a loop that is zero, of a numerator of higher order than its denominator, or behind a delay not of a
    lower one, and for a negative delay.
    """
    n = np.trim_zeros(np.asarray(loop.numerator, dtype=np.float64), "f")
    d = np.asarray(loop.denominator, dtype=np.float64)
    if not len(n) or len(n) > len(d) - (loop.delay != 0) or loop.delay < 0:
        raise UsageError(
            f"stable gains: {loop}; expected a numerator that isn't zero, of no higher order than the denominator's, or with a "
            "delay of a lower one, and no negative delay"
        )
    return _behind_delay(loop, n, d) if loop.delay else _rational(n, d)


def _rational(n: Array, d: Array) -> tuple[tuple[float, float], ...]:
    """The gains at the finitely many ω at which N(jω) D(-jω) is real; between these gains, one tried decides."""
    odd = np.convolve(n, mirror(d))[::-1][1::2][::-1]
    squares = positive_roots(mirror(odd)) if len(odd) else np.empty(0)
    limits = {0.0, math.inf}
    for omega in [0.0, *np.sqrt(squares).tolist()]:
        above = complex(np.polyval(n, 1j * omega))
        if above:
            k = -(complex(np.polyval(d, 1j * omega)) / above).real
            limits.add(k if k > 0 else 0.0)
    if len(n) == len(d) and n[0] * d[0] < 0:
        limits.add(float(-d[0] / n[0]))  # a root passes through infinity there
    ranges: list[tuple[float, float]] = []
    for low, high in pairwise(sorted(limits)):
        if not _is_stable(n, d, _between(low, high, n, d)):
            continue
        joined = bool(ranges) and ranges[-1][1] == low and _is_stable(n, d, low)
        ranges[-1:] = [(ranges[-1][0], high)] if joined else [*ranges[-1:], (low, high)]
    return tuple(ranges)


def _between(low: float, high: float, n: Array, d: Array) -> float:
    """A gain between two; where nothing else is known, one at which N and D weigh about the same."""
    return 0.5 * (low + high) if math.isfinite(high) else 2 * low or balance_gain(n, d)


def balance_gain(n: Array, d: Array) -> float:
    """Return the gain at which N (m + 1,) and D (n + 1,), highest power first, weigh the same at the size of a middling pole."""
    poles = np.abs(np.roots(d))
    at = float(np.median(poles[poles > 0])) if (poles > 0).any() else 1.0
    return float(np.polyval(np.abs(d), at) / np.polyval(np.abs(n), at))


def closed_polynomial(n: Array, d: Array, k: float) -> Array:
    """Return D + k N (n + 1,), whose roots are the closed loop's poles, for N (m + 1,) and D (n + 1,), highest power first."""
    return np.asarray(np.polyadd(d, k * n), dtype=np.float64)


def _is_stable(n: Array, d: Array, k: float) -> bool:
    return verdict_of(poles_of(closed_polynomial(n, d, k))) == "stable"


def _behind_delay(loop: TransferFunction, n: Array, d: Array) -> tuple[tuple[float, float], ...]:
    limits = sorted(_limits(loop, n, d), key=lambda limit: limit.gain)
    below = 0.5 * limits[0].gain
    right = closed_loop(replace(loop, numerator=tuple(below * c for c in loop.numerator))).right
    if right is None:
        raise UsageError(
            f"stable gains: {loop} with {below:g} of its gain can't be distinguished from the border of stability; "
            "check it with closed_loop, gain by gain"
        )
    ranges, low = [], 0.0
    for limit in limits:
        if right == 0 and limit.gain > low * (1 + _APART):
            ranges.append((low, limit.gain))
        low, right = limit.gain, right + limit.more
    return tuple(ranges)


def _limits(loop: TransferFunction, n: Array, d: Array) -> list[_Limit]:
    """All limits up to a gain beyond which poles only move to the right: no larger gain makes the loop stable."""
    phase = Phase.of(loop)
    edges = _edges(loop, n, d)
    limits = [_Limit(gain=_gain(n, d, 0.0), more=_at_zero(n, d, loop.delay))] if n[-1] * d[-1] < 0 else []
    for low, high in pairwise(edges):
        for omega, falls in _crossings(phase, low, high):
            limits.append(_Limit(gain=_gain(n, d, omega), more=2 if falls else -2))
    # Beyond the last edge the phase falls and |L| with it, so that the gains grow from one crossing to the next.
    taken_back = max((limit.gain for limit in limits if limit.more < 0), default=0.0)
    for omega in _crossings_beyond(phase, edges[-1], loop.delay, len(n) + len(d)):
        limits.append(_Limit(gain=_gain(n, d, omega), more=2))
        if limits[-1].gain > taken_back:
            return limits
    raise UsageError(
        f"stable gains: the delay of {loop.delay:g} s turns the loop more than {_MOST} times before its poles only "
        "move to the right; that is too far to search"
    )


def _edges(loop: TransferFunction, n: Array, d: Array) -> list[float]:
    """Frequencies [rad/s] between which phase and magnitude each only rise or only fall, 0 the first of them.

    At a root on the imaginary axis the phase jumps.
    """
    jumps = [
        abs(pole.at.imag) for part in (n, d) for pole in poles_of(part) if pole.side == 0 and pole.at.imag
    ]
    return sorted({0.0, *turning_points(loop), *jumps})


def _crossings(phase: Phase, low: float, high: float) -> Iterator[tuple[float, bool]]:
    """The frequencies of a phase of an odd multiple of π between two edges [rad/s], and whether it falls there."""
    # A jump at an edge is no part of what is between the edges.
    start, end = math.nextafter(low, math.inf), math.nextafter(high, 0.0)
    first, last = _turns(phase, start), _turns(phase, end)
    falls = last < first
    if low == 0 and first == round(first):  # what is real and negative at ω = 0 crosses there and not here
        first += -1e-12 if falls else 1e-12
    lowest, highest = sorted((math.floor(first), math.floor(last)))
    if highest - lowest > _MOST:
        raise UsageError(
            f"stable gains: the delay turns the loop {highest - lowest} times; that is too far to search"
        )
    for turn in range(lowest + 1, highest + 1):
        level = _TURN * turn - math.pi
        if (phase(start) - level) * (
            phase(end) - level
        ) > 0:  # the level is an edge's own, but for its rounding
            yield (start if abs(phase(start) - level) < abs(phase(end) - level) else end), falls
        else:
            yield _at_level(phase, level, start, end), falls


def _crossings_beyond(phase: Phase, low: float, delay: float, roots: int) -> Iterator[float]:
    """The frequencies of a phase of an odd multiple of π beyond the last edge [rad/s], from where on it falls without end."""
    start = math.nextafter(low, math.inf)
    first = _turns(phase, start)
    turn = math.floor(first) - (1 if low == 0 and first == round(first) else 0)
    for _ in range(_MOST):
        level = _TURN * turn - math.pi
        # No root holds the phase up by more than π.
        end = start + (max(phase(start) - level, 0.0) + (roots + 1) * math.pi) / delay
        start = _at_level(phase, level, start, end) if phase(start) > level else start
        yield start
        turn -= 1


def _at_level(phase: Phase, level: float, start: float, end: float) -> float:
    return crossing(lambda omega: phase(omega) - level, start, end)


def _turns(phase: Phase, omega: float) -> float:
    """The turns by which the phase is above -180°; next to ω = 0 it is a multiple of 90° exactly."""
    angle = phase(omega)
    if omega == _FIRST:
        angle = 0.5 * math.pi * round(2 * angle / math.pi)
    return (angle + math.pi) / _TURN


def _gain(n: Array, d: Array, omega: float) -> float:
    return float(abs(np.polyval(d, 1j * omega)) / abs(np.polyval(n, 1j * omega)))


def _at_zero(n: Array, d: Array, delay: float) -> int:
    """Of the pole that passes s = 0: 1 where it goes to the right as the gain grows, -1 where it comes back."""
    # dF/dk = N, and F' = D' + k N' - k d N at s = 0, where k = -D/N: ds/dk = -N/F'.
    k = -d[-1] / n[-1]
    slope = _derivative(d)[-1] + k * (_derivative(n)[-1] - delay * n[-1])
    return 1 if -n[-1] * slope > 0 else -1


def _derivative(polynomial: Array) -> Array:
    return np.asarray(np.polyder(polynomial) if len(polynomial) > 1 else [0.0], dtype=np.float64)

"""Nyquist's criterion: whether a closed loop is stable, from its open loop with the exact delay.

The closed loop's poles are the zeros of F(s) = D(s) + N(s) e^(-s d). F has no poles, so that by the argument principle it has

    Z = n/2 - Δ/π,    Δ: by how much the phase of F(jω) grows from ω = 0 to ∞, n: the order of D

zeros in the right half-plane, of infinitely many where there is a delay (Mikhailov 1938; Michiels and Niculescu 2014,
section 1.2). As N/D falls, F follows D beyond some frequency, and what is left of its phase is known. The encirclements of -1 by
L, clockwise and with a half-circle to the right about each pole on the imaginary axis, are Z - P, P the poles of L to the right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.systems.responses import positive_roots, squared_magnitude
from servobench.systems.stability.poles import poles_of
from servobench.systems.stability.verdict import StabilityVerdict, verdict_of
from servobench.systems.transfer_function import TransferFunction

_STEP = 0.4  # rad; a phase that moves less between two frequencies, and half as much to the middle, hasn't gone round unseen
_TOUCH = 1e-9  # |F| against its parts; nearer to zero F is taken to be zero
_ROUNDS = 60  # halvings of a step
_MOST = 200_000  # frequencies examined
_LARGEST = (
    1e150  # of a coefficient, the square of which is a floating-point number, too, and that of its inverse
)


@dataclass(frozen=True, kw_only=True)
class ClosedLoop:
    """A loop once it is closed: its verdict, how many poles it has to the right, and how that comes about.

    `encirclements` of -1 by the open loop, clockwise, are `right` minus `open_right`, the poles of the open loop to the right;
    None, as `right` is, where the loop goes through -1 and is on the border. The `sentence` says all of it.
    """

    verdict: StabilityVerdict
    right: int | None
    open_right: int
    encirclements: int | None
    sentence: str


def closed_loop(loop: TransferFunction) -> ClosedLoop:
    """Return whether a loop is stable with negative feedback around it; a delay is taken as it is.

    Raises `UsageError` for a negative delay, and for a loop that doesn't fall towards high frequencies: with a delay every such
    loop hangs on what it does at frequencies that no model knows.
    """
    if loop.delay < 0:
        raise UsageError(f"Nyquist: the delay is {loop.delay:g} s; expected 0 or more")
    open_right = sum(pole.multiplicity for pole in poles_of(loop.denominator) if pole.side > 0)
    n = np.trim_zeros(np.asarray(loop.numerator, dtype=np.float64), "f")
    if not loop.delay or not len(n):
        return _rational(loop, n, open_right)
    if len(n) >= len(loop.denominator):
        raise UsageError(
            f"Nyquist: {loop} doesn't fall towards high frequencies; expected a numerator of lower order than the denominator, "
            "as every motor with its filter has"
        )
    largest = float(np.abs([*n, *loop.denominator]).max())
    if largest > _LARGEST:
        raise UsageError(
            f"Nyquist: a coefficient of the loop is {largest:.3g}; expected no more than {_LARGEST:.0e}: take a smaller gain"
        )
    smallest = float(min(abs(c) for c in (*n, *loop.denominator) if c))
    if smallest < 1 / _LARGEST:
        raise UsageError(
            f"Nyquist: a coefficient of the loop is {smallest:.3g}; expected 0, or no less than {1 / _LARGEST:.0e}: take a "
            "larger gain"
        )
    count = _zeros_to_the_right(loop)
    if count is None:
        return ClosedLoop(
            verdict="marginally stable",
            right=None,
            open_right=open_right,
            encirclements=None,
            sentence="The open loop goes through −1: the closed loop is on the border of stability.",
        )
    return judge("unstable" if count else "stable", count, open_right)


def _rational(loop: TransferFunction, n: Array, open_right: int) -> ClosedLoop:
    """Without a delay the closed loop's poles can be had."""
    closed: Array = np.asarray(np.polyadd(loop.denominator, n if len(n) else [0.0]), dtype=np.float64)
    if len(np.trim_zeros(closed, "f")) < max(len(closed), len(loop.denominator)):
        raise UsageError(
            f"Nyquist: the loop {loop} is -1 at high frequencies, so it can't be closed; expected one that falls"
        )
    poles = poles_of(closed)
    verdict = verdict_of(poles)
    right = sum(pole.multiplicity for pole in poles if pole.side > 0)
    if verdict == "marginally stable":
        at = next(pole.at for pole in poles if pole.side == 0)
        return ClosedLoop(
            verdict=verdict,
            right=right,
            open_right=open_right,
            encirclements=None,
            sentence=f"The closed loop has a pole on the imaginary axis, at {plain(abs(at.imag))} rad/s: it is on the border.",
        )
    return judge(verdict, right, open_right)


def judge(
    verdict: StabilityVerdict, right: int, open_right: int, where: str = "in the right half-plane"
) -> ClosedLoop:
    """Return a loop off the border, with its sentence; `where` says on which side of it poles make a loop unstable."""
    round_it = right - open_right
    often = {1: "once", 2: "twice"}.get(abs(round_it), f"{abs(round_it)} times")
    sense = "clockwise" if round_it > 0 else "anticlockwise"
    times = (
        f"its Nyquist curve encircles −1 {often}, {sense}"
        if round_it
        else "its Nyquist curve doesn't encircle −1"
    )
    meaning = (
        f" (each turn {sense} is a pole {'more' if round_it > 0 else 'less'} there once the loop is closed)"
        if round_it
        else ""
    )
    return ClosedLoop(
        verdict=verdict,
        right=right,
        open_right=open_right,
        encirclements=round_it,
        sentence=(
            f"The open loop has {open_right or 'no'} pole{'' if open_right == 1 else 's'} {where}, and {times}"
            f"{meaning}: "
            f"the closed loop has {right or 'none'} there and is {verdict}."
        ),
    )


def _zeros_to_the_right(loop: TransferFunction) -> int | None:
    """Z of the quasi-polynomial; None where it is zero on the imaginary axis."""
    end = _falls_from(loop)
    grown = _phase_growth(loop, end)
    if grown is None:
        return None
    # From there on: that of D, root by root, and what 1 + L has left to go to its end at 1.
    roots = np.roots(loop.denominator)
    beyond = sum(0.5 * math.pi - math.atan2(end - r.imag, -r.real) for r in roots)
    left = -float(np.angle(1 + loop(np.array([1j * end]))[0]))
    return round((len(loop.denominator) - 1) / 2 - (grown + beyond + left) / math.pi)


def _falls_from(loop: TransferFunction) -> float:
    """A frequency [rad/s] above which |L| stays below one half: beyond the last root of |D|² - 4 |N|², and of all poles."""
    n, d = squared_magnitude(loop.numerator), squared_magnitude(loop.denominator)
    last = positive_roots(np.polysub(d, 4 * n))
    size = max(float(np.abs(np.roots(loop.denominator)).max(initial=0.0)), 1e-300)
    return 1.1 * max(math.sqrt(last[-1]) if len(last) else 0.0, size)


def _phase_growth(loop: TransferFunction, end: float) -> float | None:
    """The growth of the phase of F(jω) from 0 to `end`; None where F is zero on the way."""
    corners = np.abs([*np.roots(loop.denominator), *np.roots(loop.numerator), _slow_pole(loop)])
    low = 1e-4 * min([*corners[corners > 0].tolist(), 1 / loop.delay, end])
    even = np.linspace(0.0, end, min(math.ceil(4 * end * loop.delay) + 200, _MOST))
    omega = np.union1d(np.geomspace(low, end, 400), even)
    for _ in range(_ROUNDS):
        value, size = _characteristic(loop, omega)
        if (np.abs(value) <= _TOUCH * size).any():
            return None
        turned = np.angle(value[1:] / value[:-1])
        wide = np.flatnonzero(np.abs(turned) > _STEP)
        if not len(wide):
            return float(turned.sum())
        if len(omega) + len(wide) > _MOST:
            raise UsageError(
                f"Nyquist: the delay of {loop.delay:g} s turns the loop {end * loop.delay / (2 * math.pi):.3g} times "
                "before it has fallen; that is too far to search"
            )
        omega = np.sort(np.concatenate([omega, 0.5 * (omega[wide] + omega[wide + 1])]))
    return None


def _slow_pole(loop: TransferFunction) -> float:
    """The distance from zero [1/s] to which a small gain moves the open loop's integrators; 0 where it has none.

    Of D + N next to s = 0 with m integrators there is left  d s^m + n s^l,  l zeros at 0: |s| = |n/d|^(1/(m - l)).
    """
    m, l = (len(p) - len(np.trim_zeros(p, "b")) for p in (loop.denominator, loop.numerator))
    if m <= l:
        return 0.0
    last = abs(loop.numerator[-1 - l]), abs(loop.denominator[-1 - m])
    return float((last[0] / last[1]) ** (1 / (m - l)))


def _characteristic(loop: TransferFunction, omega: Array) -> tuple[np.ndarray, Array]:
    """F(jω), and the size of its parts."""
    s = 1j * omega
    d = np.polyval(loop.denominator, s)
    n = np.polyval(loop.numerator, s) * np.exp(-loop.delay * s)
    return d + n, np.abs(d) + np.abs(n)

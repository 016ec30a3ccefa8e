"""A loop that is closed at ticks around a motor that goes on in between: exact at the ticks, whatever the sample time and delay.

The motor K/(τs + 1)[/s] behind a voltage that holds for a sample time h and acts d = m h + p later, 0 ≤ p < h: u[k-m-1] for p,
then u[k-m] for h - p (the modified z-transform; Franklin, Powell and Workman 1998, section 4.3). With q = θ + τω, q' = K u:

    q⁺ = q + K ((h - p) u[k-m] + p u[k-m-1]),   ω⁺ = a ω + K (β₁ u[k-m] + β₂ u[k-m-1]),   θ = q - τω
    a = e^(-h/τ),   β₁ = 1 - e^(-(h-p)/τ),   β₂ = e^(-(h-p)/τ) - a

All is in w = (z - 1)/(z + 1), which is j tan(ωh/2) on the unit circle, where z = e^(jωh), and has a negative real part inside of
it: what is known of polynomials in s and the imaginary axis holds in w as it stands.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array
from servobench.margins import Margins, Phase, apart, gain_crossovers, slopes, wrapped
from servobench.responses import bandwidth, positive_roots
from servobench.stability_analysis.gains import closed_polynomial
from servobench.stability_analysis.nyquist import ClosedLoop, closed_loop, judged
from servobench.transfer_function import TransferFunction
from servobench.tuning.law import SampledLaw

_TURN = 2 * math.pi
_QUARTER = 0.5 * math.pi
_EDGE = 1e-12  # relative; how far from an edge a stretch begins, so that a jump there is no part of it
_LEVEL = 1e-9  # of a turn; nearer than that a phase is at a level, as far as rounding tells


@dataclass(frozen=True, kw_only=True)
class SampledLoop:
    """L(z) = z^(-whole) N(w)/D(w), w = (z - 1)/(z + 1), of a loop that runs every `sample_time` [s].

    `numerator` (m + 1,) and `denominator` (n + 1,) stand with the highest power of w first, without a common factor w.
    `whole` is the number of whole samples of delay, `output` what is followed, `speed` or `position`.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    whole: int
    sample_time: float
    output: str

    def frequency_response(self, omega: Array) -> NDArray[np.complex128]:
        """Return L(e^(jωh)) at angular frequencies ω [rad/s] between 0 and π/h, shape (N,)."""
        alpha = 0.5 * self.sample_time * np.asarray(omega, dtype=np.float64)
        w = 1j * np.tan(alpha)
        ratio = np.polyval(self.numerator, w) / np.polyval(self.denominator, w)
        return np.asarray(ratio * np.exp(-2j * self.whole * alpha), dtype=np.complex128)

    @property
    def in_w(self) -> TransferFunction:
        """The loop as a ratio of polynomials in w, its whole samples of delay, too: z⁻¹ = (1 - w)/(1 + w).

        In w the closed loop is stable if its poles have negative real parts.
        """
        above, below = np.array(self.numerator), np.array(self.denominator)
        for _ in range(self.whole):
            above, below = np.convolve(above, [-1.0, 1.0]), np.convolve(below, [1.0, 1.0])
        return TransferFunction(
            numerator=tuple(map(float, above)),
            denominator=tuple(map(float, below)),
            output=self.output,
            unit="1",
        )

    def omega(self, v: float) -> float:
        """Return the frequency ω [rad/s] at which w = jv."""
        return 2 * math.atan(v) / self.sample_time


def around_motor(
    law: SampledLaw, gain: float, tau: float, delay: float, sample_time: float, output: str
) -> SampledLoop:
    """Return the loop of a law around K/(s (τs + 1)), to the position, which a law of a speed takes differences of.

    K is in rad/(s·V), τ [s] above 0, the delay in s; a negative one counts as none.
    """
    whole, p = divmod(max(delay, 0.0), sample_time)
    h = sample_time
    fall = -math.expm1(-h / tau)  # 1 - a
    motor = np.array([2.0 - fall, fall])  # of z - a, and (z - 1) is 2w
    late = -math.expm1(-(h - p) / tau)
    early = math.exp(-(h - p) / tau) * -math.expm1(-p / tau)
    if p:
        above = np.convolve([h - 2 * p, h], motor) - 2 * tau * np.array([late - early, fall, 0.0])
        below = np.convolve([2.0, 0.0], np.convolve([1.0, 1.0], motor))
    else:
        above = h * motor - 2 * tau * np.array([fall, 0.0])
        below = np.convolve([2.0, 0.0], motor)
    numerator = np.convolve(gain * np.convolve([-1.0, 1.0], above), law.numerator)
    denominator = np.convolve(below, law.denominator)
    while len(numerator) > 1 and len(denominator) > 1 and numerator[-1] == 0 == denominator[-1]:
        numerator, denominator = numerator[:-1], denominator[:-1]
    return SampledLoop(
        numerator=tuple(map(float, numerator)),
        denominator=tuple(map(float, denominator)),
        whole=int(whole),
        sample_time=sample_time,
        output=output,
    )


def sampled_margins(loop: SampledLoop) -> Margins:
    """Return the margins of a sampled loop, negative feedback around it, and where they are, at most at π/h.

    The gain margin is the factor nearest to 1, up or down, at which D + k N e^(-jωh whole) has a root on the unit circle,
    z = 1 and z = -1 included. Between the frequencies at which phase or magnitude turn or the magnitude is 1, all of them roots
    of polynomials, both only rise or only fall, and the crossing of -180° nearest to |L| = 1 is one that can be told.
    The delay margin is phase margin over frequency: exact for whole samples. A loop with |L| > 1 all the way has an infinite
    gain crossover, and none at all (NaN) with |L| < 1. As `margins` does it tells stability only of a loop with one gain
    crossover and no pole outside of the unit circle.
    """
    n = np.trim_zeros(np.asarray(loop.numerator), "f")
    if not len(n):
        return Margins(
            gain_margin=math.inf,
            phase_margin=math.inf,
            delay_margin=math.inf,
            gain_crossover=math.nan,
            phase_crossover=math.nan,
        )
    course = _Course.of(loop, n)
    crossovers = gain_crossovers(course.ratio)
    left = [wrapped(_TURN * course.turns(math.atan(v))) for v in crossovers]
    omegas = [loop.omega(v) for v in crossovers]
    nearest = min(range(len(left)), key=lambda k: abs(left[k]), default=None)
    factors = [*_at_the_ends(loop, n), *_between(course, crossovers)]
    factor, alpha = min(factors, key=lambda pair: apart(pair[0]), default=(math.inf, math.nan))
    return Margins(
        gain_margin=factor,
        phase_margin=math.inf if nearest is None else left[nearest],
        delay_margin=min(
            (max(phase, 0.0) / omega for phase, omega in zip(left, omegas, strict=True)), default=math.inf
        ),
        gain_crossover=omegas[nearest] if nearest is not None else course.nowhere_one,
        phase_crossover=2 * alpha / loop.sample_time,
    )


def closed_sampled_loop(loop: SampledLoop) -> ClosedLoop:
    """Return whether a sampled loop is stable once it is closed; `right` counts poles outside of the unit circle."""
    found = closed_loop(loop.in_w)
    if found.right is None or found.verdict == "marginally stable":
        return replace(
            found, sentence="The closed loop has a pole on the unit circle: it is on the border of stability."
        )
    return judged(found.verdict, found.right, found.open_right, "outside of the unit circle")


def closed_bandwidth(loop: SampledLoop) -> float:
    """Return where L/(1 + L) has 1/√2 of its gain at zero [rad/s]; infinite where it hasn't up to π/h."""
    open_loop = loop.in_w
    below = closed_polynomial(np.asarray(open_loop.numerator), np.asarray(open_loop.denominator), 1.0)
    v = bandwidth(replace(open_loop, denominator=tuple(map(float, below))))
    return loop.omega(v) if math.isfinite(v) else v


@dataclass(frozen=True, kw_only=True)
class _Course:
    """Phase and magnitude of a loop over α = ωh/2, from 0 to π/2; `ratio` is N(w)/D(w)."""

    ratio: TransferFunction
    phase: Phase
    whole: int

    @classmethod
    def of(cls, loop: SampledLoop, n: Array) -> _Course:
        ratio = TransferFunction(numerator=tuple(map(float, n)), denominator=loop.denominator)
        return cls(ratio=ratio, phase=Phase.of(ratio), whole=loop.whole)

    def turns(self, alpha: float) -> float:
        """By how many turns the phase is above -180°."""
        return (self.phase(math.tan(alpha)) - 2 * self.whole * alpha + math.pi) / _TURN

    def factor(self, alpha: float) -> float:
        """1/|L|."""
        w = 1j * math.tan(alpha)
        size = abs(np.polyval(self.ratio.numerator, w) / np.polyval(self.ratio.denominator, w))
        return 1 / float(size) if size else math.inf

    @property
    def nowhere_one(self) -> float:
        """Infinite for |L| above 1 everywhere, NaN below: what stands for the gain crossover of a loop without one."""
        return math.inf if self.factor(0.5 * _QUARTER) < 1 else math.nan

    def turning_points(self) -> list[float]:
        """Where phase or magnitude stop rising or falling, or jump [v]: with α = atan v, dα/dv = 1/(1 + v²)."""
        phase, magnitude, squared = slopes(self.ratio)
        held = np.polysub(np.convolve(phase, [1.0, 1.0]), 2.0 * self.whole * squared)
        turning = [*positive_roots(held), *(positive_roots(magnitude) if len(magnitude) else ())]
        jumps = [
            abs(root.imag)
            for root in (*self.phase.zeros, *self.phase.poles)
            if root.imag and abs(root.real) <= _LEVEL * abs(root.imag)
        ]
        return [*(math.sqrt(square) for square in turning), *jumps]


def _at_the_ends(loop: SampledLoop, n: Array) -> list[tuple[float, float]]:
    """Where a root of the closed loop passes z = 1 or z = -1: the loop is real there, and negative."""
    d = loop.denominator
    ends = [(float(n[-1]), d[-1], 0.0)]
    if len(n) == len(d):
        ends.append((float(n[0]) * (-1.0) ** loop.whole, d[0], _QUARTER))
    return [(abs(below / above), alpha) for above, below, alpha in ends if above * below < 0]


def _between(course: _Course, crossovers: list[float]) -> Iterator[tuple[float, float]]:
    """Where the phase is -180°: on each stretch the crossing with the magnitude nearest to 1, as its factor and α."""
    from scipy.optimize import brentq

    edges = sorted({math.atan(v) for v in (*crossovers, *course.turning_points())})
    for alpha in edges:
        turns = course.turns(alpha)
        if abs(turns - round(turns)) < _LEVEL:
            yield course.factor(alpha), alpha
    for low, high in pairwise([0.0, *edges, _QUARTER]):
        start, end = low + _EDGE * (high if low == 0 else low), high * (1 - _EDGE)
        first, last = course.turns(start), course.turns(end)
        levels = math.ceil(min(first, last) + _LEVEL), math.floor(max(first, last) - _LEVEL)
        if levels[0] > levels[1]:
            continue
        from_start = apart(course.factor(start)) < apart(course.factor(end))
        level = levels[0 if from_start == (first < last) else 1]
        at = float(
            brentq(lambda alpha, level=level: course.turns(alpha) - level, start, end, xtol=1e-15, rtol=1e-13)
        )
        yield course.factor(at), at

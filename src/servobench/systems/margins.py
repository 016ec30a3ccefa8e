"""The distance of a feedback loop from instability: gain, phase and delay margin of its open loop.

L(s) = C(s) G(s),   closed loop L / (1 + L)      (Åström and Murray 2008, chapter 9)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from servobench.core.channels import Array
from servobench.core.crossing import crossing
from servobench.core.errors import UsageError
from servobench.systems.responses import difference, mirror, positive_roots, product, squared_magnitude
from servobench.systems.transfer_function import TransferFunction

_TURNS = 1000  # of the delay's phase, the most that is looked through
_TURN = 2 * math.pi
_LARGEST, _SHORTEST = 1e150, 1e-100  # of a coefficient, the square of which is a number, too; of a delay [s]


@dataclass(frozen=True, kw_only=True)
class Margins:
    """The margins of a loop, and where they are.

    `gain_margin` is the factor by which the gain may grow (below 1: has to fall), `phase_margin` the phase [rad] that may still
    be lost, `delay_margin` the delay [s] that may be added: each infinite where nothing limits it. `gain_crossover` is the
    frequency at which |L| = 1 that goes with the phase margin, `phase_crossover` that at which the phase is -180° [rad/s], 0 or
    infinite for a loop that is negative there; NaN where there is none. Of several crossings the one nearest to instability
    counts.
    """

    gain_margin: float
    phase_margin: float
    delay_margin: float
    gain_crossover: float
    phase_crossover: float


def margins(loop: TransferFunction) -> Margins:
    """Return the margins of an open loop, negative feedback around it.

    They tell stability only for a loop that crosses |L| = 1 once and has no pole in the right half-plane, as servo loops do.
    Of another one they are distances only; `delay_margin` has the delay that a stable one bears.
    A negative delay, which no loop has and an estimate may have by chance, counts as none. Raises `UsageError` for coefficients
    beyond 1e150, and a delay that is above 0 and below 1e-100 s.
    """
    loop = _check(loop)
    at_one = gain_crossovers(loop)
    phase = Phase.of(loop)
    phases = [wrap_phase(phase(omega) + math.pi) for omega in at_one]
    nearest = min(range(len(phases)), key=lambda n: abs(phases[n]), default=None)
    phase_crossovers = (
        _phase_crossovers_behind_delay(phase, loop, max(at_one, default=0.0))
        if loop.delay and any(loop.numerator)
        else _phase_crossovers(loop)
    )
    factors = [*_at_the_ends(loop), *((_factor(loop, omega), omega) for omega in phase_crossovers)]
    factor, at = min(factors, key=lambda pair: apart(pair[0]), default=(math.inf, math.nan))
    return Margins(
        gain_margin=factor,
        phase_margin=math.inf if nearest is None else phases[nearest],
        delay_margin=min(
            (max(left, 0.0) / omega for left, omega in zip(phases, at_one, strict=True)),
            default=math.inf,
        ),
        gain_crossover=math.nan if nearest is None else at_one[nearest],
        phase_crossover=at,
    )


def delay_margin(loop: TransferFunction) -> float:
    """Return the delay [s] that a loop bears which is stable once it is closed, at however many frequencies its gain is 1.

    A delay d turns L(jω) by -ωd. Where |L| = 1 it meets -1 after what its phase is above -180°, taken between 0 and 360°: the
    first of these counts (Åström and Murray 2008, section 9.3). Infinite where |L| is never 1. Raises what `margins` raises.
    """
    loop = _check(loop)
    phase = Phase.of(loop)
    return min(
        (math.fmod(wrap_phase(phase(w) + math.pi) + _TURN, _TURN) / w for w in gain_crossovers(loop)),
        default=math.inf,
    )


def _check(loop: TransferFunction) -> TransferFunction:
    largest = max(map(abs, (*loop.numerator, *loop.denominator)))
    if largest > _LARGEST:
        raise UsageError(
            f"margins: a coefficient of the loop is {largest:.3g}; expected no more than {_LARGEST:.0e}: take a smaller gain"
        )
    if 0 < loop.delay < _SHORTEST:
        raise UsageError(
            f"margins: the delay is {loop.delay:g} s; expected 0 or {_SHORTEST:.0e} s at least: leave it out"
        )
    return replace(loop, delay=max(loop.delay, 0.0))


def series(first: TransferFunction, then: TransferFunction) -> TransferFunction:
    """Return two systems one after the other; what comes out, and its name, is the second one's."""
    return TransferFunction(
        numerator=tuple(map(float, np.convolve(first.numerator, then.numerator))),
        denominator=tuple(map(float, np.convolve(first.denominator, then.denominator))),
        delay=first.delay + then.delay,
        output=then.output,
        unit=f"{then.unit}·{first.unit}",
    )


def _value(loop: TransferFunction, omega: float) -> complex:
    return complex(np.polyval(loop.numerator, 1j * omega) / np.polyval(loop.denominator, 1j * omega))


def _factor(loop: TransferFunction, omega: float) -> float:
    """1/|L| at a frequency [rad/s]."""
    size = abs(_value(loop, omega))
    return 1 / size if size else math.inf


def apart(factor: float) -> float:
    """Return by how much a factor is off 1, up or down, as a logarithm."""
    return abs(math.log(factor)) if factor else math.inf


def _at_the_ends(loop: TransferFunction) -> list[tuple[float, float]]:
    """The gain factors and frequencies at which a pole of the closed loop crosses at s = 0 or through infinity, where L < 0."""
    ends = [(loop.numerator[-1], loop.denominator[-1], 0.0)]
    if len(loop.numerator) == len(loop.denominator) and not loop.delay:
        ends.append((loop.numerator[0], loop.denominator[0], math.inf))
    return [(abs(below / above), omega) for above, below, omega in ends if above * below < 0]


def gain_crossovers(loop: TransferFunction) -> list[float]:
    """Return where |N(jω)|² = |D(jω)|² [rad/s]; a delay has no part in it."""
    n, d = squared_magnitude(loop.numerator), squared_magnitude(loop.denominator)
    return [math.sqrt(square) for square in positive_roots(np.polysub(n, d))]


def _phase_crossovers(loop: TransferFunction) -> list[float]:
    """The frequencies at which a rational L(jω) is negative: N(jω) D(-jω) has no imaginary part, and a negative real one."""
    product = np.convolve(loop.numerator, mirror(np.asarray(loop.denominator, dtype=np.float64)))
    even, odd = product[::-1][::2][::-1], product[::-1][1::2][::-1]  # of s⁰, s², … and of s¹, s³, …
    squares = positive_roots(mirror(odd)) if len(odd) else np.empty(0)
    real = mirror(even).tolist()
    return [math.sqrt(x) for x in squares if np.polyval(real, x) < 0]


def _phase_crossovers_behind_delay(
    phase: Phase, loop: TransferFunction, gain_crossover: float
) -> list[float]:
    """The crossings of -180° by the phase of a loop with a delay whose magnitude is nearest to 1, of infinitely many such.

    Between two frequencies that are examined phase and magnitude each only rise or only fall, so that no narrow resonance
    hides a crossing, and the magnitude at one isn't nearer to 1 than the stretch that it is in. Looked for up to one more turn
    of the phase beyond all corners and the gain crossover: from there on a loop falls. Beyond twice its distance from zero a
    root turns the phase by no more than π/6. A delay of more than a thousand turns there is beyond any control, and beyond what
    is looked through.
    """
    both = [*phase.zeros, *phase.poles]
    roots = np.abs(both)
    corners = [*roots[roots > 0], *([gain_crossover] if gain_crossover else [])]
    span = _TURN / loop.delay
    low = 1e-3 * min([*corners, span])
    high = min(2 * max([*corners, 0.0]) + (1 + len(both) / 12) * span, _TURNS * span)
    even = np.linspace(low, high, math.ceil(16 * high / span))
    spread = np.geomspace(low, high, 16 * math.ceil(math.log10(high / low)))
    # Behind real poles alone, none to the right, phase and magnitude fall everywhere.
    falls = not phase.zeros and all(pole.imag == 0 and pole.real <= 0 for pole in phase.poles)
    own = np.array([] if falls else [*turning_points(loop), *(abs(root.imag) for root in both)])
    omega = np.unique(np.concatenate([even, spread, own[(own > low) & (own < high)]]))
    turns = (phase.course(omega) + math.pi) / _TURN
    whole = np.floor(turns)
    crossed = np.flatnonzero(whole[1:] != whole[:-1])
    distances = [_nearest_to_one(loop, omega[n], omega[n + 1]) for n in crossed]
    crossings: list[float] = []
    best = math.inf
    for n, distance in sorted(zip(crossed, distances, strict=True), key=lambda pair: pair[1]):
        if distance > best:
            break
        for turn in range(int(min(whole[n], whole[n + 1])) + 1, int(max(whole[n], whole[n + 1])) + 1):
            level = _TURN * turn - math.pi
            at = crossing(partial(_above, phase, level), omega[n], omega[n + 1])
            crossings.append(at)
            best = min(best, apart(_factor(loop, at)))
    return crossings


def _above(phase: Phase, level: float, omega: float) -> float:
    """By how much the phase at a frequency is above a level [rad]."""
    return phase(omega) - level


def _nearest_to_one(loop: TransferFunction, low: float, high: float) -> float:
    """The least distance of |L| from 1 between two frequencies [rad/s] between which it only rises or falls."""
    one, two = (_factor(loop, float(omega)) for omega in (low, high))
    return 0.0 if (one - 1) * (two - 1) <= 0 else min(apart(one), apart(two))


def turning_points(loop: TransferFunction) -> list[float]:
    """Return the frequencies [rad/s] at which the phase or the magnitude of a loop stops rising or falling, but for its jumps.

    At a root on the imaginary axis the phase jumps.
    """
    n = np.trim_zeros(np.asarray(loop.numerator, dtype=np.float64), "f")
    phase, magnitude, squared = slopes(n, np.asarray(loop.denominator, dtype=np.float64))
    held = difference(phase, loop.delay * squared)
    squares = [*positive_roots(held), *(positive_roots(magnitude) if len(magnitude) else ())]
    return [math.sqrt(square) for square in squares]


def slopes(numerator: Array, denominator: Array) -> tuple[Array, Array, Array]:
    """Return how phase and magnitude of N/D, without a delay, rise and fall: three polynomials in ω², highest power first.

    With L'/L = P/|ND|², P = (N'D - ND')(s) (ND)(-s) at s = jω, the slope of the phase over ω is the first, Re P, over the third,
    |ND|², by algebra; that of ln |L| is zero where the second is, or at ω = 0. N (m + 1,) has a leading coefficient that isn't
    zero; of stacks N (M, m + 1) and D (M, n + 1) it is three stacks.
    """
    both = product(numerator, denominator)
    above = difference(
        product(_derivative(numerator), denominator), product(numerator, _derivative(denominator))
    )
    whole = product(above, mirror(both))
    even, odd = whole[..., ::-1][..., ::2][..., ::-1], whole[..., ::-1][..., 1::2][..., ::-1]  # of s⁰, s², …
    return mirror(even), mirror(odd), squared_magnitude(both)


def _derivative(polynomial: Array) -> Array:
    order = polynomial.shape[-1] - 1
    return polynomial[..., :-1] * np.arange(order, 0.0, -1.0) if order else np.zeros_like(polynomial)


@dataclass(frozen=True, kw_only=True)
class Phase:
    """The phase of a loop [rad] over frequency, without jumps: those of its zeros and poles [rad/s], sign and delay [s] together.

    That of jω - r goes on without a jump for a root r in the right half-plane, too.
    """

    zeros: tuple[complex, ...]
    poles: tuple[complex, ...]
    sign: float
    delay: float

    @classmethod
    def of(cls, loop: TransferFunction) -> Phase:
        """Return the phase of a loop, of its zeros, its poles [rad/s], its sign and its delay [s]."""
        leading = next((x for x in loop.numerator if x), 0.0)
        return cls(
            zeros=tuple(map(complex, loop.zeros)),
            poles=tuple(map(complex, loop.poles)),
            sign=math.pi if leading / loop.denominator[0] < 0 else 0.0,
            delay=loop.delay,
        )

    def __call__(self, omega: float) -> float:
        """Return the phase [rad] at a frequency [rad/s]."""
        angle = self.sign - self.delay * omega
        for roots, sense in ((self.zeros, 1.0), (self.poles, -1.0)):
            for r in roots:
                left = math.atan2(omega - r.imag, abs(r.real))
                angle += sense * (left if r.real <= 0 else math.pi - left)
        return angle

    def course(self, omega: Array) -> Array:
        """Return the phase at frequencies (N,) [rad/s]."""
        angle = self.sign - self.delay * omega
        for roots, sense in ((self.zeros, 1.0), (self.poles, -1.0)):
            for r in roots:
                left = np.arctan2(omega - r.imag, abs(r.real))
                angle += sense * (left if r.real <= 0 else math.pi - left)
        return angle


def wrap_phase(phase: float) -> float:
    """Return the same phase [rad] within (-π, π]."""
    rest = math.remainder(phase, _TURN)
    return math.pi if rest == -math.pi else rest

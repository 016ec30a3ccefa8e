"""How far a feedback loop is from instability: gain, phase and delay margin of its open loop.

L(s) = C(s) G(s),   closed loop L / (1 + L)      (Åström and Murray 2008, chapter 9)
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from servobench.channels import Array
from servobench.responses import mirrored, positive_roots, squared_magnitude
from servobench.transfer_function import TransferFunction

_TURNS = 1000  # of the delay's phase, the most that is looked through
_CANDIDATES = (
    3  # crossings of -180° with a magnitude near 1 that are worked out, of infinitely many behind a delay
)
_TURN = 2 * math.pi


@dataclass(frozen=True, kw_only=True)
class Margins:
    """The margins of a loop, and where they are.

    `gain_margin` is the factor by which the gain may grow (below 1: has to fall), `phase_margin` the phase [rad] that may still
    be lost, `delay_margin` the delay [s] that may be added: each infinite where nothing limits it. `gain_crossover` is the
    frequency at which |L| = 1 that goes with the phase margin, `phase_crossover` that at which the phase is -180° [rad/s]; NaN
    where there is none. Of several crossings the one nearest to instability counts.
    """

    gain_margin: float
    phase_margin: float
    delay_margin: float
    gain_crossover: float
    phase_crossover: float


def margins(loop: TransferFunction) -> Margins:
    """Return the margins of an open loop, negative feedback around it.

    They tell stability only for a loop that crosses |L| = 1 once and has no pole in the right half-plane, as servo loops do.
    A negative delay, which no loop has and an estimate may have by chance, counts as none.
    """
    loop = replace(loop, delay=max(loop.delay, 0.0))
    gain_crossovers = _gain_crossovers(loop)
    phase = Phase.of(loop)
    phases = [_wrapped(phase(omega) + math.pi) for omega in gain_crossovers]
    nearest = min(range(len(phases)), key=lambda n: abs(phases[n]), default=None)
    phase_crossovers = (
        _phase_crossovers_behind_delay(phase, loop, max(gain_crossovers, default=0.0))
        if loop.delay
        else _phase_crossovers(loop)
    )
    factors = [(1 / abs(_value(loop, omega)), omega) for omega in phase_crossovers]
    factor, at = min(factors, key=lambda pair: abs(math.log(pair[0])), default=(math.inf, math.nan))
    return Margins(
        gain_margin=factor,
        phase_margin=math.inf if nearest is None else phases[nearest],
        delay_margin=min(
            (max(left, 0.0) / omega for left, omega in zip(phases, gain_crossovers, strict=True)),
            default=math.inf,
        ),
        gain_crossover=math.nan if nearest is None else gain_crossovers[nearest],
        phase_crossover=at,
    )


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


def _gain_crossovers(loop: TransferFunction) -> list[float]:
    """Where |N(jω)|² = |D(jω)|² [rad/s]; a delay has no part in it."""
    n, d = squared_magnitude(loop.numerator), squared_magnitude(loop.denominator)
    return [math.sqrt(square) for square in positive_roots(np.polysub(n, d))]


def _phase_crossovers(loop: TransferFunction) -> list[float]:
    """Where L(jω) of a rational loop is real and negative: N(jω) D(-jω) has no imaginary part, and a negative real one."""
    product = np.convolve(loop.numerator, mirrored(np.asarray(loop.denominator, dtype=np.float64)))
    even, odd = product[::-1][::2][::-1], product[::-1][1::2][::-1]  # of s⁰, s², … and of s¹, s³, …
    squares = positive_roots(mirrored(odd)) if len(odd) else np.empty(0)
    real = mirrored(even).tolist()
    return [math.sqrt(x) for x in squares if np.polyval(real, x) < 0]


def _phase_crossovers_behind_delay(
    phase: Phase, loop: TransferFunction, gain_crossover: float
) -> list[float]:
    """Where the phase of a loop with a delay crosses -180°: the few crossings whose magnitude is nearest to 1.

    Looked for up to one more turn of the delay's phase beyond all corners and the gain crossover: from there on a loop falls.
    A delay of more than a thousand turns there is beyond any control, and beyond what is looked through.
    """
    from scipy.optimize import brentq

    roots = np.abs([*phase.zeros, *phase.poles])
    corners = [*roots[roots > 0], *([gain_crossover] if gain_crossover else [])]
    span = _TURN / loop.delay
    low, high = 1e-3 * min([*corners, span]), min(2 * max([*corners, 0.0]) + span, _TURNS * span)
    even = np.linspace(low, high, math.ceil(16 * high / span))
    omega = np.union1d(np.geomspace(low, high, 16 * math.ceil(math.log10(high / low))), even)
    turns = (phase.course(omega) + math.pi) / _TURN
    crossed = np.flatnonzero(np.floor(turns[1:]) != np.floor(turns[:-1]))
    sizes = np.abs([_value(loop, float(x)) for x in omega[crossed]])
    nearest = crossed[np.argsort(np.abs(np.log(sizes + 1e-300)), kind="stable")[:_CANDIDATES]]
    levels = _TURN * np.maximum(np.floor(turns[nearest]), np.floor(turns[nearest + 1])) - math.pi
    return [
        float(brentq(lambda x, level=level: phase(x) - level, omega[n], omega[n + 1], rtol=1e-12))
        for n, level in zip(nearest, levels, strict=True)
    ]


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


def _wrapped(phase: float) -> float:
    """The same phase within (-π, π]."""
    rest = math.remainder(phase, _TURN)
    return math.pi if rest == -math.pi else rest

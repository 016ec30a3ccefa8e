"""A sampled loop around a continuous motor: exact at the ticks, for any sample time and delay.

The motor G(s) = C (sI - A)⁻¹ B stands behind a voltage that holds for a sample time h and acts d = m h + p later, 0 ≤ p < h:
u[k-m-1] for p, then u[k-m] for h - p (the modified z-transform; Franklin, Powell and Workman 1998, section 4.3):

    x[k+1] = e^(Ah) x[k] + Γ(h - p) u[k-m] + e^(A(h-p)) Γ(p) u[k-m-1],   Γ(t) = ∫ e^(As) B ds from 0 to t

All is in w = (z - 1)/(z + 1), which is j tan(ωh/2) on the unit circle, where z = e^(jωh), and has a negative real part inside of
it: what holds for polynomials in s and the imaginary axis holds in w as it stands. docs/decisions/0028-sampled-loop.md says why.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial, reduce
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.crossing import crossing
from servobench.core.errors import UsageError
from servobench.core.matrix_exponential import matrix_exponential
from servobench.systems.margins import Margins, Phase, apart, gain_crossovers, slopes, wrap_phase
from servobench.systems.responses import difference, positive_roots, product, roots
from servobench.systems.transfer_function import TransferFunction

_TURN = 2 * math.pi
_QUARTER = 0.5 * math.pi
EDGE = 1e-12  # relative; how far from an edge a stretch begins, so that a jump there is no part of it
LEVEL = 1e-9  # of a turn; nearer than that a phase is at a level, as far as rounding tells

_MOST_STATES = 1000  # of a closed loop: the time for its poles grows with their cube


@dataclass(frozen=True, kw_only=True)
class SampledLaw:
    """C(w) of a law that runs at even ticks, from the error (or the output with its sign turned round) to the input.

    z = (1 + w)/(1 - w); `numerator` and `denominator`, (n + 1,) each, stand with the highest power of w first.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def at(self, w: complex) -> complex:
        """Return C(w)."""
        return complex(np.polyval(self.numerator, w) / np.polyval(self.denominator, w))


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

    def at(self, s: complex) -> complex:
        """Return L(e^(sh)) at a complex frequency s [1/s]."""
        w = cmath.tanh(0.5 * self.sample_time * s)
        ratio = np.polyval(self.numerator, w) / np.polyval(self.denominator, w)
        return complex(ratio) * cmath.exp(-self.whole * self.sample_time * s)

    def closed_poles(self, factor: float = 1.0) -> NDArray[np.complex128]:
        """Return the poles z (P,) of the closed loop, negative feedback around so many times L, as eigenvalues of its states.

        The samples that are on their way are states, too: as polynomials they would be of an order as large as the delay.
        Raises `UsageError` where that makes more than 1000 states.
        """
        a, b, c, direct = self._states()
        if not self.whole:
            return np.asarray(np.linalg.eigvals(a - factor / (1 + factor * direct) * np.outer(b, c)))
        order, m = len(a), self.whole
        if order + m > _MOST_STATES:
            raise UsageError(
                f"the loop's delay is {m} of its sample times of {self.sample_time:g} s, too many to find its poles; "
                f"expected fewer than {_MOST_STATES}: give a longer sample time"
            )
        closed = np.zeros((order + m, order + m))
        closed[:order, :order], closed[:order, -1] = a, -factor * b
        closed[order, :order] = c
        closed[order, -1] -= factor * direct
        closed[order + 1 :, order:-1] += np.eye(m - 1)
        return np.asarray(np.linalg.eigvals(closed), dtype=np.complex128)

    def _states(self) -> tuple[Array, Array, Array, float]:
        """A, B, C and D in z of N(w)/D(w): the controllable form in w, carried over by w = (z - 1)/(z + 1)."""
        d: Array = np.asarray(self.denominator) / self.denominator[0]
        order = len(d) - 1
        n = np.zeros(order + 1)
        n[order + 1 - len(self.numerator) :] = np.asarray(self.numerator) / self.denominator[0]
        matrix = np.eye(order, k=-1)
        matrix[:1] -= d[1:]
        inverse: Array = np.asarray(np.linalg.inv(np.eye(order) - matrix), dtype=np.float64)
        b, c = inverse[:, 0], np.asarray((n[1:] - n[0] * d[1:]) @ inverse)
        a = np.asarray(np.eye(order) + 2 * matrix @ inverse)
        return a, b, np.asarray(2 * c), float(n[0] + c[:1].sum())

    def omega(self, v: float) -> float:
        """Return the frequency ω [rad/s] at which w = jv."""
        return 2 * math.atan(v) / self.sample_time


def sampled_loop(
    law: SampledLaw, system: TransferFunction, sample_time: float, output: str = ""
) -> SampledLoop:
    """Return the loop of a law around a system with its delay, whose input holds for `sample_time` [s].

    `output` is what the loop follows; without it, what comes out of the system. A negative delay, which an estimate may have by
    chance, counts as none. Raises `UsageError` for a sample time that isn't above zero, and for a system with more zeros than
    poles, which no input that holds can drive.
    """
    return sampled_loops(law, [system], sample_time, output)[0]


def sampled_loops(
    law: SampledLaw, systems: Sequence[TransferFunction], sample_time: float, output: str = ""
) -> list[SampledLoop]:
    """Return the loops of one law, every `sample_time` [s], around each of many systems, as `sampled_loop` does of one."""
    held = _zero_order_holds(systems, _check(sample_time))
    return [
        _around(law, *each, sample_time, output or system.output)
        for each, system in zip(held, systems, strict=True)
    ]


def _around(
    law: SampledLaw, numerator: Array, denominator: Array, whole: int, sample_time: float, output: str
) -> SampledLoop:
    above = np.convolve(numerator, law.numerator).tolist()
    below = np.convolve(denominator, law.denominator).tolist()
    while len(above) > 1 and len(below) > 1 and above[-1] == 0 == below[-1]:
        above, below = above[:-1], below[:-1]
    return SampledLoop(
        numerator=tuple(above), denominator=tuple(below), whole=whole, sample_time=sample_time, output=output
    )


def sampled_series(controller: TransferFunction, system: TransferFunction, sample_time: float) -> SampledLoop:
    """Return the loop of a controller C(s), computed by the trapezoid rule, around a system; delays [s] of both add up."""
    return sampled_series_of_each(controller, [system], sample_time)[0]


def sampled_series_of_each(
    controller: TransferFunction, systems: Sequence[TransferFunction], sample_time: float
) -> list[SampledLoop]:
    """Return the loops of a controller, every `sample_time` [s], around each of many systems, as `sampled_series` does of one."""
    if controller.delay:
        systems = [replace(system, delay=max(system.delay, 0.0) + controller.delay) for system in systems]
    return sampled_loops(trapezoid(controller, sample_time), systems, sample_time)


def law_in_z(numerator: Sequence[Sequence[float]], denominator: Sequence[Sequence[float]]) -> SampledLaw:
    """Return the law of a ratio of polynomials in z, each given by its factors, highest power first, and of the same order.

    A factor that is exactly zero at z = 1, such as a difference, is exactly zero at w = 0.
    """
    above, below = (
        reduce(np.convolve, [np.array(in_w([Fraction(c) for c in each]), float) for each in factors])
        for factors in (numerator, denominator)
    )
    return SampledLaw(numerator=tuple(map(float, above)), denominator=tuple(map(float, below)))


def in_w(polynomial: Sequence[Fraction]) -> list[Fraction]:
    """Return (1 - w)^n P((1 + w)/(1 - w)) for P(z) of order n, the highest power first."""
    order = len(polynomial) - 1
    total = [Fraction(0)] * (order + 1)
    for n, coefficient in enumerate(polynomial):
        term = [coefficient]
        for sign in (1,) * (order - n) + (-1,) * n:  # of z^(order - n): (1 + w)^(order - n) (1 - w)^n
            term = [
                sign * high + low
                for high, low in zip([*term, Fraction(0)], [Fraction(0), *term], strict=True)
            ]
        total = [x + y for x, y in zip(total, term, strict=True)]
    return total


def proportional(gain: float) -> SampledLaw:
    """Return the law u = gain · error."""
    return SampledLaw(numerator=(gain,), denominator=(1.0,))


def trapezoid(controller: TransferFunction, sample_time: float) -> SampledLaw:
    """Return C(s) as it is computed at ticks of `sample_time` [s] by the trapezoid rule, s = 2w/h (Tustin 1947).

    One with more zeros than poles, such as a derivative without a filter, would ring forever by that rule; it is computed with
    differences between two ticks, s = (z - 1)/(hz). Raises `UsageError` for a sample time that isn't above zero.
    """
    n, d = np.trim_zeros(np.asarray(controller.numerator), "f"), np.asarray(controller.denominator)
    order = max(len(n), len(d)) - 1
    scale = 2 / _check(sample_time)
    later = [1.0, 1.0] if len(n) > len(d) else [1.0]  # s = 2w/h over this
    return SampledLaw(
        numerator=tuple(_substitute(n, order, scale, later)),
        denominator=tuple(_substitute(d, order, scale, later)),
    )


def _check(sample_time: float) -> float:
    if not (math.isfinite(sample_time) and sample_time > 0):
        raise UsageError(f"the sample time of a loop is {sample_time:g} s; expected more than 0 s")
    return sample_time


def _substitute(polynomial: Array, order: int, scale: float, below: list[float]) -> list[float]:
    """P(scale · w / below(w)) times below(w)^order, the highest power of w first."""
    total = np.zeros(1)
    for power, coefficient in enumerate(polynomial[::-1]):
        term = np.array([coefficient * scale**power, *[0.0] * power])
        for _ in range(order - power):
            term = np.convolve(term, below)
        total = np.polyadd(total, term)
    return [float(c) for c in total]


_MOST_TICKS = 100_000  # of delay


def _zero_order_holds(systems: Sequence[TransferFunction], h: float) -> list[tuple[Array, Array, int]]:
    """N(w), D(w) and the whole ticks of delay of systems behind an input that holds; time is counted in ticks of h [s]."""
    ticks = [_ticks(system, h) for system in systems]
    alike: dict[tuple[int, int, int, int, bool], list[int]] = {}
    for n, (system, (_, part)) in enumerate(zip(systems, ticks, strict=True)):
        sizes = (_leading_zeros(system.numerator), len(system.numerator), len(system.denominator))
        integrators = _leading_zeros(system.denominator[::-1])
        alike.setdefault((*sizes, integrators, part > 0), []).append(n)
    result: dict[int, tuple[Array, Array, int]] = {}
    for (leading, *_), at in alike.items():
        above, below = _zero_order_hold(
            np.array([systems[n].numerator[leading:] for n in at], dtype=np.float64),
            np.array([systems[n].denominator for n in at], dtype=np.float64),
            np.array([ticks[n][1] for n in at]),
            h,
        )
        result |= {n: (above[k], below[k], ticks[n][0]) for k, n in enumerate(at)}
    return [result[n] for n in range(len(systems))]


def _ticks(system: TransferFunction, h: float) -> tuple[int, float]:
    """The whole ticks of h [s] in a system's delay, and the part of one that is left; a mere gain acts at ticks only."""
    if system.delay > _MOST_TICKS * h:
        raise UsageError(
            f"the model's delay of {system.delay:.3g} s is more than {_MOST_TICKS} sample times of {h:g} s; a loop "
            "can't be closed around that"
        )
    zeros = len(system.numerator) - _leading_zeros(system.numerator) - 1
    if zeros > len(system.denominator) - 1:
        raise UsageError(f"sampled loop: {system}; expected no more zeros than poles")
    whole, part = divmod(max(system.delay, 0.0), h)
    if len(system.denominator) == 1:
        return int(whole) + (part > 0), 0.0
    return int(whole), part / h


def _leading_zeros(polynomial: Sequence[float]) -> int:
    return next((n for n, coefficient in enumerate(polynomial) if coefficient), len(polynomial))


def _zero_order_hold(n: Array, d: Array, part: Array, h: float) -> tuple[Array, Array]:
    """N(w) and D(w) of systems (M, m + 1) and (M, k + 1) of one form whose input holds and is a `part` (M,) of a tick late.

    One form: the denominators have the same number of roots at zero, and either all inputs are late or none.
    """
    order = d.shape[1] - 1
    powers = h ** np.arange(order + 1.0)
    a = d / d[:, :1] * powers  # of s^order ... 1 in ticks
    full = np.concatenate([np.zeros((len(n), order + 1 - n.shape[1])), n], axis=1) / d[:, :1] * powers
    direct, c = full[:, :1], full[:, 1:] - full[:, :1] * a[:, 1:]
    if not order:
        return direct, np.ones_like(direct)
    late = bool(part.any())
    transition, forced = _steps(a, np.array([1 - part, part] if late else [1 - part]))
    inputs = [forced[0]]
    if late:
        inputs.append(transition[0] @ forced[1])
        transition = transition[:1] @ transition[1:]
    identity = np.eye(order)
    # (zI - A) = ((I + A) w + I - A)/(1 - w), so that the system in w has the matrix (I + A)⁻¹(A - I).
    solved = np.linalg.solve(
        identity + transition[0], np.concatenate([transition[0] - identity, *inputs], axis=-1)
    )
    matrix, inputs_in_w = solved[..., :order], solved[..., order:]
    below = _tangents(d, h)
    rows = _adjugate_rows(c, matrix, below) @ inputs_in_w  # C adj(wI - A_w) B of each input
    minus, plus = np.array([-1.0, 1.0]), np.array([1.0, 1.0])
    above = product(rows[..., 0], minus)
    if late:  # z⁻¹ = (1 - w)/(1 + w)
        above = product(above, plus) + product(product(rows[..., 1], minus), minus)
        if n.shape[1] > order:
            above += direct * product(below, minus)
        return above, product(below, plus)
    return (above + direct * below if n.shape[1] > order else above), below


def _steps(a: Array, lengths: Array) -> tuple[Array, Array]:
    """The transitions of the states (…, n, n) over numbers of ticks: e^(At), and Γ(t) (…, n, 1) of a constant input.

    A is in the controllable form, by its polynomials (M, n + 1); `lengths` (…, M).
    """
    order = a.shape[1] - 1
    block = np.zeros((len(a), order + 1, order + 1))
    block[:, 0, :order], block[:, 0, order] = -a[:, 1:], 1.0
    block[:, 1:order, : order - 1] = np.eye(order - 1)
    whole = matrix_exponential(block * lengths[..., None, None])
    return whole[..., :order, :order], whole[..., :order, order:]


def _tangents(d: Array, h: float) -> Array:
    """The denominators (M, n + 1) in w: a pole p has become tanh(ph/2), one at zero stays there exactly."""
    below = np.zeros(d.shape, dtype=np.complex128)
    below[:, 0] = 1.0
    for k, root in enumerate(np.tanh(0.5 * h * roots(d)).T):
        below[:, 1 : k + 2] -= below[:, : k + 1] * root[:, None]
    return np.asarray(below.real)


def _adjugate_rows(c: Array, a: Array, below: Array) -> Array:
    """The coefficients (M, n, n) of C adj(wI - A), the highest power first, by Faddeev's and Leverrier's recursion."""
    rows = [c]
    for k in range(1, below.shape[1] - 1):
        rows.append((rows[-1][:, None] @ a)[:, 0] + below[:, k, None] * c)
    return np.stack(rows, axis=1)


def sampled_margins(loop: SampledLoop) -> Margins:
    """Return the margins of a sampled loop, negative feedback around it, and where they are, at most at π/h.

    The gain margin is the factor nearest to 1, up or down, at which D + k N e^(-jωh whole) has a root on the unit circle,
    z = 1 and z = -1 included. Between the frequencies at which phase or magnitude turn or the magnitude is 1, all of them roots
    of polynomials, both only rise or only fall, and the crossing of -180° nearest to |L| = 1 is one that can be told.
    The delay margin is phase margin over frequency: exact for whole samples. A loop with |L| > 1 all the way has an infinite
    gain crossover, and none at all (NaN) with |L| < 1. As `margins` does it tells stability only of a loop with one gain
    crossover and no pole outside the unit circle.
    """
    return margins_and_gain_range(loop)[0]


def margins_and_gain_range(loop: SampledLoop) -> tuple[Margins, tuple[float, float]]:
    """Return the margins of a sampled loop, and the factors on its gain, below and above 1, that end its stability.

    The margins are those of `sampled_margins`; a factor is 0 or infinite where none ends the stability.
    """
    n = np.trim_zeros(np.asarray(loop.numerator), "f")
    if not len(n):
        none = Margins(
            gain_margin=math.inf,
            phase_margin=math.inf,
            delay_margin=math.inf,
            gain_crossover=math.nan,
            phase_crossover=math.nan,
        )
        return none, (0.0, math.inf)
    course = _Course.of(loop, n)
    crossovers = gain_crossovers(course.ratio)
    met = [*_at_the_ends(loop, n), *_between(course, crossovers, _nearest_to_one)]
    below = max((factor for factor, _ in met if factor < 1), default=0.0)
    above = min((factor for factor, _ in met if factor >= 1), default=math.inf)
    return _margins_of(loop, course, crossovers, met), (below, above)


def _margins_of(
    loop: SampledLoop, course: _Course, crossovers: list[float], met: list[tuple[float, float]]
) -> Margins:
    """The margins by the gain crossovers [v] and the points of phase -180°, as 1/|L| and α."""
    left = [wrap_phase(_TURN * course.turns(math.atan(v))) for v in crossovers]
    omegas = [loop.omega(v) for v in crossovers]
    nearest = min(range(len(left)), key=lambda k: abs(left[k]), default=None)
    factor, alpha = min(met, key=lambda pair: apart(pair[0]), default=(math.inf, math.nan))
    return Margins(
        gain_margin=factor,
        phase_margin=math.inf if nearest is None else left[nearest],
        delay_margin=min(
            (max(phase, 0.0) / omega for phase, omega in zip(left, omegas, strict=True)), default=math.inf
        ),
        gain_crossover=omegas[nearest] if nearest is not None else course.nowhere_one,
        phase_crossover=2 * alpha / loop.sample_time,
    )


def sampled_delay_margin(loop: SampledLoop) -> float:
    """Return the delay [s] that a sampled loop bears which is stable once it is closed, at however many frequencies |L| is 1.

    As `margins.delay_margin`: infinite where |L| is never 1.
    """
    n = np.trim_zeros(np.asarray(loop.numerator), "f")
    if not len(n):
        return math.inf
    course = _Course.of(loop, n)
    return min(
        (course.turns(math.atan(v)) % 1 * _TURN / loop.omega(v) for v in gain_crossovers(course.ratio)),
        default=math.inf,
    )


def gain_limits(loop: SampledLoop) -> list[float]:
    """Return all factors on the gain at which the closed loop has a pole on the unit circle, in no order."""
    n = np.trim_zeros(np.asarray(loop.numerator), "f")
    if not len(n):
        return []
    course = _Course.of(loop, n)
    met = _between(course, gain_crossovers(course.ratio), lambda levels, _: levels)
    return [factor for factor, _ in (*_at_the_ends(loop, n), *met)]


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
        """The turns by which the phase is above -180°."""
        return (self.phase(math.tan(alpha)) - 2 * self.whole * alpha + math.pi) / _TURN

    def factor(self, alpha: float) -> float:
        """1/|L|."""
        w = 1j * math.tan(alpha)
        above = abs(_value(self.ratio.numerator, w))
        return abs(_value(self.ratio.denominator, w)) / above if above else math.inf

    @property
    def nowhere_one(self) -> float:
        """Infinite for |L| above 1 everywhere, NaN below: what stands for the gain crossover of a loop without one."""
        return math.inf if self.factor(0.5 * _QUARTER) < 1 else math.nan

    def turning_points(self) -> list[float]:
        """The points at which phase or magnitude stop rising or falling, or jump [v]: with α = atan v, dα/dv = 1/(1 + v²)."""
        phase, magnitude, squared = slopes(*map(np.asarray, (self.ratio.numerator, self.ratio.denominator)))
        held = difference(np.convolve(phase, [1.0, 1.0]), 2.0 * self.whole * squared)
        turning = [*positive_roots(held), *(positive_roots(magnitude) if len(magnitude) else ())]
        jumps = [
            abs(root.imag)
            for root in (*self.phase.zeros, *self.phase.poles)
            if root.imag and abs(root.real) <= LEVEL * abs(root.imag)
        ]
        return [*(math.sqrt(square) for square in turning), *jumps]


def _value(polynomial: Sequence[float], w: complex) -> complex:
    """P(w) by Horner's rule: of a few coefficients NumPy's takes ten times as long."""
    total = 0j
    for coefficient in polynomial:
        total = total * w + coefficient
    return total


def _at_the_ends(loop: SampledLoop, n: Array) -> list[tuple[float, float]]:
    """The gain factors at which a root of the closed loop passes z = 1 or z = -1: the loop is real there, and negative."""
    d = loop.denominator
    ends = [(float(n[-1]), d[-1], 0.0)]
    if len(n) == len(d):
        ends.append((float(n[0]) * (-1.0) ** loop.whole, d[0], _QUARTER))
    return [(abs(below / above), alpha) for above, below, alpha in ends if above * below < 0]


def _nearest_to_one(levels: range, first: bool) -> Iterable[int]:
    """Of the levels of the phase on a stretch the one at the end where the magnitude is nearer to 1."""
    return levels[:1] if first else levels[-1:]


def _turns_above(course: _Course, level: int, alpha: float) -> float:
    return course.turns(alpha) - level


def _between(
    course: _Course, crossovers: list[float], chosen: Callable[[range, bool], Iterable[int]]
) -> Iterator[tuple[float, float]]:
    """The points of phase -180°, as 1/|L| and α: on each stretch between the edges, of the levels crossed those chosen."""
    edges = sorted({math.atan(v) for v in (*crossovers, *course.turning_points())})
    for alpha in edges:
        turns = course.turns(alpha)
        if abs(turns - round(turns)) < LEVEL:
            yield course.factor(alpha), alpha
    for low, high in pairwise([0.0, *edges, _QUARTER]):
        start, end = low + EDGE * (high if low == 0 else low), high * (1 - EDGE)
        first, last = course.turns(start), course.turns(end)
        levels = range(math.ceil(min(first, last) + LEVEL), math.floor(max(first, last) - LEVEL) + 1)
        rises = first < last
        if len(levels) > 1 and not apart(course.factor(start)) < apart(course.factor(end)):
            rises = not rises
        for level in chosen(levels, rises):
            at = crossing(partial(_turns_above, course, level), start, end)
            yield course.factor(at), at

"""A motor followed sample by sample at a reference, with the filters that estimate the error of the reference."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.identification.estimators.covariance import conservative
from servobench.identification.estimators.recursion import kernels
from servobench.identification.estimators.recursion.bank import Bank, Likeliest, full, move_products
from servobench.identification.models.kernels import ANGLE, COLUMNS, COULOMB, DELAY, OFFSET, RATE, at_start

_STRETCHES = 64  # of the run whose sums are kept apart
_ENOUGH = 3  # stretches for each parameter, before their scatter says anything
_NEAR = 1.5  # in ln(q/r): the innovations of two filters are as good as the same
_RECENT = 400  # blocks whose innovations are kept


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """Samples y (M,) at t (M,) [s], and inputs u (N,) that hold from t_in (N,) [s]."""

    t: Array
    y: Array
    t_in: Array
    u: Array

    def then(self, later: Samples) -> Samples:
        """Return these samples and later ones."""
        both = zip((self.t, self.y, self.t_in, self.u), (later.t, later.y, later.t_in, later.u), strict=True)
        t, y, t_in, u = (np.concatenate(pair) for pair in both)
        return Samples(t=t, y=y, t_in=t_in, u=u)

    def check(self, last: float) -> None:
        """Raise `UsageError` for samples that nothing can be made of, or that come before the `last` one [s]."""
        for t, x, what in ((self.t, self.y, "position"), (self.t_in, self.u, "input")):
            if t.ndim != 1 or t.shape != x.shape:
                raise UsageError(
                    f"the {what} has values of shape {x.shape}, times of shape {t.shape}; expected (N,) both"
                )
            if not (np.isfinite(t).all() and np.isfinite(x).all()):
                raise UsageError(f"the {what} has values that are not finite; leave those rows out")
            if (np.diff(t) <= 0).any():
                raise UsageError(f"the times of the {what} don't increase everywhere; give the rows in order")
        if len(self.t) and not self.t[0] > last:
            raise UsageError(
                f"a row at {self.t[0]:g} s came after one at {last:g} s; give the rows in order, or start again"
            )

    def since(self, count: int) -> Samples:
        """Return the last `count` samples with the inputs of their time."""
        first = max(len(self.t) - count, 0)
        start = int(np.searchsorted(self.t_in, self.t[first]))
        return Samples(t=self.t[first:], y=self.y[first:], t_in=self.t_in[start:], u=self.u[start:])


NOTHING = Samples(t=np.empty(0), y=np.empty(0), t_in=np.empty(0), u=np.empty(0))


@dataclass(eq=False)
class Motion:
    """The state: a reference (7,) of (K, τ, u₀, u_c, d, θ, ω at the start) in SI units, the motor there, and the bank of filters.

    Bounded however long the run is. `piece` (4, 8) is the piece of the motor's course under way, see `kernels`; `senses` (3,)
    counts the samples at which it turned forwards, backwards, and rested. `pending` are samples that an input is still missing
    for, `residuals` (R,) the newest ones [rad], `left` is the number of samples until the stretch under way ends. `friction` is
    1 or 0: whether u_c acts. `stretches` are the sums of all filters at the ends of equal stretches of the run, `recent` the
    last innovations (K, 8) of the filter `shown`. `rest` is the variance of the rounding's error at rest beside that of a
    sample on the way. `quantum` is a step of the encoder [rad] (0: it isn't known).
    """

    reference: Array
    friction: float
    bank: Bank
    piece: Array
    motor: Array
    quantum: float = 0.0
    rest: float = 1.0
    senses: Array = field(default_factory=lambda: np.zeros(3))
    pending: Samples = NOTHING
    shown: int = 0
    recent: Array = field(default_factory=lambda: np.empty((0, COLUMNS + 1)))
    residuals: Array = field(default_factory=lambda: np.empty(0))
    stretches: list[Array] = field(default_factory=list)
    stretch: int = 0
    left: int = 0

    @classmethod
    def initial(
        cls,
        reference: Array,
        friction: float,
        sample_time: float,
        rest: float = 1.0,
        shown: int = 0,
        quantum: float = 0.0,
    ) -> Motion:
        """Return a motor that hasn't begun to move, at a reference (7,), sampled every `sample_time` [s]; see the class."""
        bank = Bank.initial(float(reference[1]), sample_time)
        stretch = max(int(reference[1] / sample_time), 1)
        return cls(
            reference=reference.copy(), friction=friction, bank=bank, piece=np.empty(0), motor=np.full(3, np.nan),
            quantum=quantum, rest=rest, shown=shown, stretches=[np.zeros_like(bank.products)], stretch=stretch, left=stretch,
        )  # fmt: skip

    def take(self, samples: Samples, input_before: float, change: Array) -> Array:
        """Follow the motor through samples and return their residuals, y - prediction, at the reference and a `change` (7,).

        `input_before` is what held before the first sample of a record.

        Samples that an input of later rows may still act on, as a delay may be a little below zero, wait for those rows.
        """
        samples = self.pending.then(samples)
        if not len(samples.t):
            self.pending = samples
            return np.empty(0)
        if not self.piece.size:
            self.piece = at_start(self.reference)
            self.motor[:] = samples.t[0], input_before, 0.0
        known = samples.t_in[-1] if len(samples.t_in) else -np.inf
        ready = len(samples.t)
        if self.reference[DELAY] < 0:
            ready = int(np.searchsorted(samples.t, known + self.reference[DELAY], side="right"))
        residual = np.empty(ready)
        begun = 0
        while begun < ready:
            until = min(begun + self.left, ready)
            samples = self._follow(samples, begun, until, change, residual)
            self.left -= until - begun
            begun = until
            if not self.left:
                self._end_stretch()
        self.pending = Samples(t=samples.t[ready:], y=samples.y[ready:], t_in=samples.t_in, u=samples.u)
        return residual

    def _follow(self, samples: Samples, begun: int, until: int, change: Array, residual: Array) -> Samples:
        """Take the samples from `begun` to `until`; returns the samples with the inputs that haven't acted yet."""
        b, here = self.bank, slice(begun, until)
        innovations = np.empty((2 * (until - begun) + 1, COLUMNS + 1))
        acted, count = kernels.stream(
            samples.t[here], samples.y[here], samples.t_in, samples.u, self.piece, self.motor, self.reference,
            self.friction, 1.5 * b.sample_time, self.rest, b.sizes, b.filters, b.blocks, b.totals, b.ratio, b.p, b.angle, b.speed,
            b.products, b.logarithms, self.quantum, b.sines, self.senses, self.shown, change, residual[here], innovations,
        )  # fmt: skip
        self.recent = np.concatenate([self.recent, innovations[:count]])[-_RECENT:]
        self.residuals = np.concatenate([self.residuals, residual[here]])[-_RECENT:]
        return Samples(t=samples.t, y=samples.y, t_in=samples.t_in[acted:], u=samples.u[acted:])

    def _end_stretch(self) -> None:
        """Keep the sums so far; where there are too many of them, every other one goes, and stretches get twice as long."""
        self.stretches.append(self.bank.products.copy())
        if len(self.stretches) > _STRETCHES:
            self.stretches = self.stretches[::2]
            self.stretch *= 2
        self.left = self.stretch

    @property
    def both_ways(self) -> bool:
        """Whether the motor has turned both ways: at least one moving sample in fifty the other way, for a time constant."""
        least = max(0.02 * self.senses[:2].sum(), self.reference[1] / self.bank.sample_time)
        return bool(self.senses[:2].min() > least)

    @property
    def rested(self) -> bool:
        """Whether friction has held the shaft for a while."""
        return bool(self.senses[2] > 0)

    def blocks_in(self, duration: float) -> int:
        """Return how many blocks of the filter `shown` span a duration [s], at least one."""
        length = self.bank.sizes[np.searchsorted(self.bank.filters, self.shown, side="right") - 1]
        return max(int(np.ceil(duration / (length * self.bank.sample_time))), 1)

    def answer(self, free: NDArray[np.bool_]) -> Likeliest | None:
        """Return how far the reference is off in the `free` (7,) parameters, with a covariance that allows for colour.

        The scatter of the scores between stretches holds whatever colour is shorter than they are (Liang and Zeger 1986).
        None where the data are too few.
        """
        answer = self.bank.likeliest(free)
        if answer is None:
            return None
        # Another level may be likeliest because the motor has changed: who watches for that stays with the old one.
        if not len(self.recent):
            self.shown = answer.watched
        answer = replace(answer, watched_variance=self.bank.residual_after(self.shown, answer.change))
        at = answer.informed
        if answer.calm and self.quantum:
            exact = self.bank.by_rounding(self.quantum, at)
            answer = replace(answer, covariance=_wider(answer.covariance, exact, at))
        sums = full(np.diff(np.array([one[answer.filter] for one in self.stretches]), axis=0))
        count = len(sums)
        if count < _ENOUGH * len(at):
            return answer
        scores = sums[:, :-1, -1] - sums[:, :-1, :-1] @ answer.change
        meat = scores.T @ scores * (count / (count - len(at)))
        robust = answer.inverse @ meat @ answer.inverse
        return replace(answer, covariance=_wider(answer.covariance, robust, at))

    def watch(self, likeliest: Likeliest) -> None:
        """Watch the innovations at the noise level that is likeliest now, if it is another one than before."""
        if self.bank.apart(likeliest.watched, self.shown) > _NEAR:
            self.shown, self.recent = likeliest.watched, self.recent[:0]

    def shift(self, change: Array) -> None:
        """Move the reference by a change (7,), with all that was seen, and the motor where it is now, to first order."""
        self.bank.shift(change)
        self.stretches = [move_products(full(one), change) for one in self.stretches]
        self.recent[:, -1] -= self.recent[:, :-1] @ change
        for row in (ANGLE, RATE):
            self.piece[row, -1] += self.piece[row, :-1] @ change
        self.reference += change

    def start_again(self) -> None:
        """Begin a new record: its start state is unknown, and has nothing to do with the motion so far."""
        self.bank.start_again()
        self.pending, self.piece = NOTHING, np.empty(0)
        self.recent, self.residuals = self.recent[:0], self.residuals[:0]
        self.stretches, self.left = [self.bank.products.copy()], self.stretch


def _wider(first: Array, second: Array, at: NDArray[np.int64]) -> Array:
    """The second covariance (7, 7) over the columns `at`, made no narrower than the first."""
    out, here = first.copy(), np.ix_(at, at)
    out[here] = conservative(first[here], second[here])
    return out


def possible(
    change: Array, likeliest: Likeliest, reference: Array, sample_time: float, is_brake: bool
) -> Array:
    """Return a change (7,) that leads to parameters that can be: τ > 0, d at most two samples early, a friction that brakes.

    The reference (7,) is that of a `Motion`, in SI units, the samples are `sample_time` [s] apart.

    A friction that would be negative is held at zero, and the others are moved as they go along with it.
    """
    out = change.copy()
    at = COULOMB
    if is_brake and likeliest.covariance[at, at] > 0 and reference[at] + out[at] < 0:
        away = -reference[at] - out[at]
        out += likeliest.covariance[:, at] / likeliest.covariance[at, at] * away
        out[at] = -reference[at]
    out[1] = max(out[1], -0.5 * reference[1])
    out[DELAY] = max(out[DELAY], -2 * sample_time - reference[DELAY])
    return out


def unknowns(friction: float, both_ways: bool) -> NDArray[np.bool_]:
    """Return which columns (7,) are to be found: u₀ without friction, u_c where the motor turns one way, else both."""
    free = np.ones(COLUMNS, dtype=bool)
    free[OFFSET] = not friction or both_ways
    free[COULOMB] = bool(friction)
    return free

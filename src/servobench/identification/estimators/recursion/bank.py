"""A bank of Kalman filters, one for each noise level, and the parameters from all of them.

Each filter has seen the means of blocks of [J r], the Jacobian and the residual at a reference, and keeps the sum of the products
of their innovations: the best change of the parameters, its covariance and the likelihood of the noise level need no more,
however many samples there are. The levels are those of `estimators.disturbance`: q/r, from a torque that never shows to one
that exceeds the noise within a sample. docs/decisions/0022-recursive.md says why all levels are used at once. Blocks have a few
lengths, as there: short compared with τ, and with the memory of the most likely filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.estimators.encoder_rounding import SINES, shares
from servobench.identification.estimators.recursion import kernels

LEVELS_APART = 0.7  # in ln(q/r): a level in between makes less than a tenth of a standard deviation
_SHORT = 0.33  # of τ: the longest block
_LEAST = 0.35  # of a block: the shortest memory of its filters
_MOST = 16.0  # of a block: the longest memory of the filters of all but the longest blocks
_FINER = 2.0  # times a block: a more likely memory below that needs shorter blocks
_LONGEST = 1000.0  # τ: a memory that is as good as endless
_SHOWN = 2.71  # the likelihood ratio that 5 % of the runs without a torque exceed
_KNOWN = 1e-14  # of the largest eigenvalue: a direction about which nothing is known


@dataclass(frozen=True, eq=False)
class Bank:
    """Filters and their sums, changed in place by `kernels.stream`: B lengths of blocks, F filters, 8 columns [J r].

    `freedom` (F,) counts the start states that were swept out of the sums, `sines` (16, 7) has what an encoder's rounding makes
    of the scores where no torque acts. Blocks of `sizes` (B,) samples, `sample_time` [s] apart, have the `filters` from one
    number to the next (B + 1,); `blocks` and `totals` (B, 8) are those under way, and `ratio` (F,), covariances p (F, 3),
    states `angle` and `speed` (F, 8), sums of `products` (F, 8, 8) and `logarithms` (F,) are described at
    `kernels.close_block`.
    """

    sample_time: float
    sizes: NDArray[np.int64]
    filters: NDArray[np.int64]
    ratio: Array
    blocks: Array
    totals: Array
    p: Array
    angle: Array
    speed: Array
    products: Array
    logarithms: Array
    freedom: Array
    sines: Array

    @classmethod
    def initial(cls, tau: float, sample_time: float) -> Self:
        """Return filters that have seen nothing, for a time constant and a sample time [s]."""
        sizes, levels = [max(int(_SHORT * tau / sample_time), 1)], []
        while sizes[-1] > 1:
            sizes.append(sizes[-1] // 2)
        for n, size in enumerate(sizes):
            longest = max(_LONGEST * tau, 100 * sample_time) if n == 0 else _MOST * size * sample_time
            low, high = (4 * np.log(memory) for memory in (longest, _LEAST * size * sample_time))
            count = 1 + int(np.ceil((low - high) / LEVELS_APART))
            levels.append(sample_time * np.exp(-low + LEVELS_APART * np.arange(count)))
        ratio = np.concatenate(levels)
        blocks = np.zeros((len(sizes), 6))
        blocks[:, kernels.BEFORE] = np.nan
        width, count = kernels.WIDTH, len(ratio)
        return cls(
            sample_time=sample_time,
            sizes=np.array(sizes, dtype=np.int64),
            filters=np.concatenate([[0], np.cumsum([len(some) for some in levels])]).astype(np.int64),
            ratio=ratio,
            blocks=blocks,
            totals=np.zeros((len(sizes), width)),
            p=np.zeros((count, 3)),
            angle=np.zeros((count, width)),
            speed=np.zeros((count, width)),
            products=np.zeros((count, width, width)),
            logarithms=np.zeros(count),
            freedom=np.zeros(count),
            sines=np.zeros((2 * SINES, width - 1)),
        )

    def likeliest(self, free: NDArray[np.bool_]) -> Likeliest | None:
        """Return what the filters make of the `free` (7,) parameters; None where there are too few blocks to say anything."""
        for n in range(len(self.sizes)):
            answer = self._of_blocks(n, free)
            if answer is None:
                return None
            memory = (self.sample_time / self.ratio[answer.filter]) ** 0.25
            if memory >= _FINER * self.sizes[n] * self.sample_time:
                return answer
        return answer

    def _of_blocks(self, n: int, free: NDArray[np.bool_]) -> Likeliest | None:
        """The same for one length of blocks."""
        here = slice(int(self.filters[n]), int(self.filters[n + 1]))
        products = full(self.products[here])
        informed = np.flatnonzero(free & (np.diagonal(products, axis1=1, axis2=2)[:, :-1] > 0).all(axis=0))
        means = self.blocks[n, kernels.MEANS] - self.freedom[here] - len(informed)
        if not len(informed) or means.min() < len(informed):
            return None
        inverse, information = _inverses(products[:, informed[:, None], informed])
        g = products[:, informed, -1]
        change = np.einsum("fij,fj->fi", inverse, g)
        squares = products[:, -1, -1] - np.einsum("fi,fi->f", g, change)
        variance = np.maximum(squares / means, 1e-300)
        deviance = means * np.log(variance) + self.logarithms[here] + information
        best = int(np.argmin(deviance))
        weight = np.exp(-0.5 * (deviance - deviance[best]))
        weight /= weight.sum()
        apart = change - change[best]
        covariance = np.einsum("f,fij->ij", weight * variance, inverse) + (apart * weight[:, None]).T @ apart
        calm = n == 0 and deviance[0] - deviance[best] < _SHOWN
        return Likeliest(
            filter=here.start + best,
            **self._coarser(here.start + best, n, _in_place(change[best], informed)),
            means=float(means[best]),
            variance=float(variance[best]),
            informed=informed,
            change=_in_place(change[best], informed),
            covariance=_in_place(covariance, informed),
            inverse=_in_place(inverse[best], informed),
            deviance=float(deviance[best]),
            calm=bool(calm),
        )

    def by_rounding(self, quantum: float, informed: NDArray[np.int64]) -> Array:
        """Return the covariance (7, 7) that rounding to steps of `quantum` [rad] leaves where no torque acts.

        That is H⁻¹ (S'S + white) H⁻¹ of output error; see `encoder_rounding`.
        """
        inverse, _ = _inverses(full(self.products[0])[np.ix_(informed, informed)][None])
        powers = shares()
        moved_by = quantum * np.sqrt(np.repeat(powers, 2))[:, None] * self.sines[:, informed] @ inverse[0]
        white = quantum**2 * (1 / 12 - float(powers.sum()))
        return _in_place(moved_by.T @ moved_by + white * inverse[0], informed)

    def _coarser(self, best: int, n: int, change: Array) -> dict[str, Any]:
        """The filter of the same noise level over twice as long blocks, over which rounding is whiter, and r there."""
        longer = max(n - 1, 0)
        first, last = int(self.filters[longer]), int(self.filters[longer + 1])
        at = first + int(np.argmin(np.abs(np.log(self.ratio[first:last] / self.ratio[best]))))
        return {"watched": at, "watched_variance": self.residual_after(at, change)}

    def residual_after(self, at: int, change: Array) -> float:
        """Return r as a filter finds it after a change (7,) of the reference."""
        n = int(np.searchsorted(self.filters, at, side="right")) - 1
        squares = float(move_products(full(self.products[at]), change)[-1, -1])
        return max(squares / max(float(self.blocks[n, kernels.MEANS]), 1.0), 1e-300)

    def apart(self, one: int, other: int) -> float:
        """Return how far apart in ln(q/r) two filters are; infinitely where they have blocks of another length."""
        lengths = np.searchsorted(self.filters, [one, other], side="right")
        return (
            float(np.abs(np.log(self.ratio[one] / self.ratio[other]))) if lengths[0] == lengths[1] else np.inf
        )

    def shift(self, change: Array) -> None:
        """Move the reference of all that was seen by a change (7,): r becomes r - J change."""
        for rows in (self.totals, self.angle, self.speed):
            rows[:, -1] -= rows[:, :-1] @ change
        self.products[:] = move_products(full(self.products), change)

    def start_again(self) -> None:
        """Let the start state of what was seen go: what it makes of the other parameters is kept, a new one comes."""
        products = full(self.products)
        own = np.array([5, 6])
        rest = np.setdiff1d(np.arange(kernels.WIDTH), own)
        for f, m in enumerate(products):
            inverse, information = _inverses(m[np.ix_(own, own)][None])
            if f == 0:  # that of output error, whose residuals the sines are multiplied by
                self.sines[:, :5] -= self.sines[:, own] @ inverse[0] @ m[np.ix_(own, np.arange(5))]
                self.sines[:, own] = 0.0
            swept = m[np.ix_(rest, rest)] - m[np.ix_(rest, own)] @ inverse[0] @ m[np.ix_(own, rest)]
            self.products[f] = 0.0
            self.products[f][np.ix_(rest, rest)] = swept
            self.logarithms[f] += information[0]
            self.freedom[f] += np.count_nonzero(np.diag(m)[own])
        self.totals[:], self.p[:], self.angle[:], self.speed[:] = 0.0, 0.0, 0.0, 0.0
        self.blocks[:, : kernels.BEFORE] = 0.0
        self.blocks[:, kernels.BEFORE] = np.nan
        self.blocks[:, kernels.RESTED] = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Likeliest:
    """The parameters according to those blocks' filters that fit.

    `filter` is the likeliest one, with r as `variance`, H⁻¹ as `inverse` (7, 7), and the best `change` (7,) under it. The
    `covariance` (7, 7) allows for the uncertainty of the level: Σ w (C + δ δ') over all levels with their likelihoods as
    weights, δ their changes from the best one's. `informed` are the columns of which the data say something, `means` the
    degrees of freedom that are left. `watched` is the filter whose innovations tell whether the motor still is what it was,
    with its own r, `watched_variance`. `deviance` is -2 ln of the likeliest one's likelihood. `calm` says that nothing shows a
    torque.
    """

    filter: int
    watched: int
    watched_variance: float
    means: float
    variance: float
    informed: NDArray[np.int64]
    change: Array
    covariance: Array
    inverse: Array
    deviance: float
    calm: bool


def full(products: Array) -> Array:
    """Return symmetric matrices (F, W, W) of which the upper triangles are given."""
    upper = np.triu(products)
    return np.asarray(upper + np.swapaxes(np.triu(products, 1), -1, -2), dtype=np.float64)


def move_products(products: Array, change: Array) -> Array:
    """Return the products [J r]'[J r] (F, 8, 8) after r has become r - J change (7,)."""
    to = np.eye(kernels.WIDTH)
    to[:-1, -1] = -change
    return np.asarray(to.T @ products @ to, dtype=np.float64)


def _in_place(x: Array, at: NDArray[np.int64]) -> Array:
    """A vector or a matrix over some columns as one over all seven, zero elsewhere."""
    size = kernels.WIDTH - 1
    if x.ndim == 1:
        out = np.zeros(size)
        out[at] = x
        return out
    square = np.zeros((size, size))
    square[np.ix_(at, at)] = x
    return square


def _inverses(h: Array) -> tuple[Array, Array]:
    """H⁻¹ and ln |H| of matrices (F, P, P), from scaled parameters; those without any information are left out of both."""
    size = np.diagonal(h, axis1=1, axis2=2)
    scale = np.where(size > 0, 1.0 / np.sqrt(np.where(size > 0, size, 1.0)), 0.0)
    both = scale[:, :, None] * scale[:, None, :]
    values, vectors = np.linalg.eigh(h * both + np.eye(h.shape[1]) * (size <= 0)[:, :, None])
    values = np.maximum(values, _KNOWN * values[:, -1:])
    inverse = np.einsum("fij,fj,fkj->fik", vectors, 1.0 / values, vectors) * both
    logarithms = np.log(values).sum(axis=1) + np.log(np.where(size > 0, size, 1.0)).sum(axis=1)
    return np.asarray(inverse), np.asarray(logarithms)

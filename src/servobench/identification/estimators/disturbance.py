"""A random torque on the shaft in addition to measurement noise: its likelihood, and its effect on a structure.

The output is what the model simulates, plus what a white torque adds (a speed that decays with τ, and its integral), plus white
measurement noise of variance r. With q the intensity of the acceleration [1/s³ of the output's unit squared], only the
ratio q/r shapes the filter; r follows from the size of the innovations.

An encoder's rounding isn't white: at a constant speed it has almost no power at the low frequencies that carry the parameters,
or sometimes a line there. So neighbouring samples are averaged over a time that is short compared with τ and with the memory of
the filter, and r is the noise of these means, not Q²/12.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.estimators.encoder_rounding import is_rounded
from servobench.identification.estimators.least_squares import Layout
from servobench.identification.models.base import Output, Parameter, Prediction, Structure
from servobench.identification.models.turning import Sliding
from servobench.recordings.measurement.base import Kind
from servobench.recordings.measurement.dataset import Dataset, keep_with_data
from servobench.systems.transfer_function import TransferFunction

_COARSE = 16  # points of the first grid, from a torque that never shows to one that drowns the noise within a sample
_BRIEF = 0.3  # of a sample time: the first grid's shortest memory, in which a torque nearly drowns the noise
# Of a sample time: no data tell a shorter memory from it. What a torque does within a sample has 3000 times the variance of the
# noise there, and 100 times that of a speed's.
_BRIEFEST = 0.1
_FINE = np.linspace(-1.0, 1.0, 13)
_POWER = {"position": 4, "speed": 2}  # of the filter's memory T: q/r = (sample time)/T⁴, or T²
_WIDE = 3.5  # standard deviations of ln(q/r) that the fine grid spans on each side
_SHORT = 0.33  # of τ: the longest block
_QUICK = 1.0  # of the filter's memory: the longest block
_SHORTEST = (
    0.01  # of the time constant that a filter was made for: how far a search for another one goes with it
)
_WINDOW = 16  # samples that show whether a shaft moves
_STEADY = 4.0  # times the variance of white noise, which one in twenty thousand windows of it exceeds
_CREEP = 1.5  # counts: the standard deviation within a window of a shaft that moves
WEIGHED = 0.42  # of the filter's memory: the longest block that parameters are found from


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """The noise model of one data set: time constant τ [s], ratio q/r, measurement noise variance r of a sample."""

    tau: float
    """The motor's time constant [s], with which the torque's effect dies away."""
    ratio: float
    variance: float

    @property
    def wander(self) -> float:
        """The standard deviation of the speed that the torque causes in the long run, √(q τ / 2), in output units a second."""
        return float(np.sqrt(0.5 * self.ratio * self.variance * self.tau))

    def memory(self, kind: Kind, sample_time: float) -> float:
        """Return the time [s] over which the filter averages: where the torque's effect outgrows the measurement noise."""
        return float((sample_time / self.ratio) ** (1 / _POWER[kind])) if self.ratio > 0 else float("inf")

    @classmethod
    def from_memory(cls, memory: float, tau: float, kind: Kind, sample_time: float) -> Disturbance:
        """Return the disturbance for which the filter's `memory` is that long [s], with unit variance of the measurement."""
        return cls(tau=tau, ratio=sample_time / memory ** _POWER[kind], variance=1.0)


@dataclass(frozen=True, eq=False)
class Blocks:
    """Neighbouring samples and their means, (B,) each: the numbers `starts` of the first samples, counts, and mean times [s].

    `sliding` is that of their beginnings, `noise` the variance of each mean, beside r.
    """

    starts: NDArray[np.int64]
    counts: Array
    times: Array
    sliding: Sliding
    noise: Array

    def means(self, x: Array) -> Array:
        """Return the means of x (M, …) over each block, (B, …)."""
        sums = np.add.reduceat(x, self.starts, axis=0)
        return np.asarray(sums / self.counts.reshape(-1, *[1] * (x.ndim - 1)), dtype=np.float64)

    def turning_as(self, sliding: Sliding) -> Blocks:
        """Return the same blocks for a shaft that turns back as in `sliding`, of the samples; it rests where it did."""
        left, turns = np.minimum(np.ceil(self.sliding.left), 1.0), self.sliding.turns.copy()
        turned = np.flatnonzero((sliding.left > 0) & (sliding.left < 1))
        places = np.searchsorted(self.times, sliding.turns[turned])
        inside = places < len(left)
        np.multiply.at(left, places[inside], sliding.left[turned[inside]])
        turns[places[inside]] = sliding.turns[turned[inside]]
        return replace(self, sliding=Sliding(left=left, turns=turns))


def blocks_of(data: Dataset, sliding: Sliding, longest: float, rest: float | None = None) -> Blocks:
    """Return blocks of a record that are at most `longest` [s] long, and have neither a gap nor a stop or start within.

    A shaft at rest gives the same count all the time: this determines its position once, with the whole rounding error,
    however long the rest. So with `rest`, the variance of that error beside r, a rest is one block, and weighs as such. So does
    one in which a position of unknown rounding stays the same: each of its samples would seem to say that there is no noise.
    """
    t, sliding = data.t_output, _as_recorded(sliding, data)
    left = sliding.left
    rests = _rests(sliding, data) & (rest is not None)
    size = max(int(min(longest / data.sample_time, len(t))), 1)
    gaps = (np.diff(t) > 1.5 * data.sample_time) & ~(rests[1:] & rests[:-1])
    breaks = gaps | ((np.diff(left) != 0) & ((left[1:] < 1) | (left[:-1] == 0)))
    run = np.concatenate([[0], np.cumsum(breaks)])
    inside = np.where(rests, 0, (np.arange(len(t)) - np.searchsorted(run, run)) // size)
    starts = np.flatnonzero(np.concatenate([[True], breaks | (np.diff(inside) != 0)]))
    counts = np.diff(np.append(starts, len(t))).astype(np.float64)
    return Blocks(
        starts=starts,
        counts=counts,
        times=np.add.reduceat(t, starts) / counts,
        sliding=Sliding(left=left[starts], turns=sliding.turns[starts]),
        noise=np.where(rests[starts], rest or 1.0, 1 / counts),
    )


def _as_recorded(sliding: Sliding, data: Dataset) -> Sliding:
    """The same, but a shaft that the record shows to move where friction should hold it slides there: the torque moves it."""
    rests = sliding.left == 0
    if data.kind != "position" or rests.sum() < _WINDOW:
        return sliding
    within = np.lib.stride_tricks.sliding_window_view(rests, _WINDOW).all(axis=1) & _moves(data)
    moves = np.zeros(len(rests), dtype=bool)
    for first in range(_WINDOW if within.any() else 0):
        moves[first : first + len(within)] |= within
    return replace(sliding, left=np.where(moves, 1.0, sliding.left))


@keep_with_data
def _moves(data: Dataset) -> NDArray[np.bool_]:
    """Whether a position changes steadily, and by more than its rounding, in each window (M - 15,) of a record.

    In one of white noise the variance is half the mean square of the steps between samples (von Neumann 1941).
    """
    steps = np.diff(data.y)
    quantum = data.quantum or float(np.min(np.abs(steps[steps != 0]), initial=np.inf))
    variance = np.lib.stride_tricks.sliding_window_view(data.y, _WINDOW).var(axis=1)
    noise = 0.5 * np.lib.stride_tricks.sliding_window_view(steps**2, _WINDOW - 1).mean(axis=1)
    return np.asarray(variance > np.maximum(_STEADY * noise, (_CREEP * quantum) ** 2), dtype=np.bool_)


@keep_with_data
def _stays(data: Dataset) -> NDArray[np.bool_]:
    """Whether each sample (M,) of a position is the same as the one before or after it."""
    same = (np.diff(data.y) == 0) & (data.kind == "position")
    return np.asarray(np.append(same, False) | np.append(False, same), dtype=np.bool_)


def variance_of_rest(data: Dataset, disturbance: Disturbance | None) -> float:
    """Return the variance of an encoder's error at rest beside r: Q²/12 over r, one at least; one where r isn't known yet."""
    return max((data.quantum or 0.0) ** 2 / 12 / disturbance.variance, 1.0) if disturbance else 1.0


def _samples(data: Dataset, sliding: Sliding) -> Blocks:
    """Each sample as a block of its own."""
    sliding, ones = _as_recorded(sliding, data), np.ones(len(data.t_output))
    return Blocks(starts=np.arange(len(ones)), counts=ones, times=data.t_output, sliding=sliding, noise=ones)


def _samples_and_rests(data: Dataset, sliding: Sliding, rest: float) -> Blocks:
    """The same with so much noise in a rest, of variance `rest` in each beside r, that all its samples say as much as one."""
    samples = _samples(data, sliding)
    rests = _rests(samples.sliding, data)
    if not rests.any():
        return samples
    run = np.cumsum(np.diff(rests, prepend=False))
    return replace(samples, noise=np.where(rests, rest * np.bincount(run)[run], 1.0))


def _rests(sliding: Sliding, data: Dataset) -> NDArray[np.bool_]:
    """Whether each sample (M,) is of a rest in which the error of the position stays the same."""
    still: NDArray[np.bool_] = sliding.left == 0
    return still if is_rounded(data) or not still.any() else still & _stays(data)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Records near one point of the parameters: blocks of [residual, Jacobian], and where each record's columns stand.

    `places` are the columns of each record in the joint vector, `free` (P + ΣQ,) which of its entries may move. The
    `kind` of output is that of all records, the `sample_time` [s] the longest that any has. `prior` (P + ΣQ,) is what is known
    of each entry beforehand, as r over its variance.
    """

    blocks: tuple[Blocks, ...]
    columns: tuple[Array, ...]
    places: tuple[NDArray[np.int64], ...]
    free: NDArray[np.bool_]
    kind: Kind
    sample_time: float
    prior: Array | None = None

    def levels(self, tau: float) -> Array:
        """Return a grid of ln(q/r), for memories of the filter from 100 τ down to a third of a sample time."""
        memories = np.geomspace(100 * tau, _BRIEF * self.sample_time, _COARSE)
        return np.asarray(np.log(self.sample_time / memories ** _POWER[self.kind]), dtype=np.float64)

    @property
    def highest_level(self) -> float:
        """The ln(q/r) above which no data tell q/r."""
        return float(np.log(self.sample_time / (_BRIEFEST * self.sample_time) ** _POWER[self.kind]))

    def under(self, tau: float, ratio: float) -> Trial:
        """Return the parameters for noise with the given τ and q/r, and its likelihood."""
        return self.under_each(tau, np.array([ratio]))[0]

    def under_each(self, tau: float, ratios: Array) -> tuple[Trial, ...]:
        """Return the same for each of several q/r (T,)."""
        from servobench.identification.estimators import kernels

        size, count = len(self.free), len(ratios)
        changes, inverses = np.empty((count, size)), np.empty((count, size, size))
        variances, deviances = np.empty(count), np.empty(count)
        position = float(self.kind == "position")
        kernels.likelihoods_of_ratios(
            *self._rows,
            self.free,
            np.zeros(size) if self.prior is None else self.prior,
            tau,
            ratios,
            position,
            1.0 - position,
            changes,
            inverses,
            variances,
            deviances,
        )
        return tuple(
            Trial(
                ratio=float(ratios[n]),
                change=changes[n],
                covariance=variances[n] * inverses[n],
                variance=float(variances[n]),
                deviance=float(deviances[n]),
            )
            for n in range(count)
        )

    @cached_property
    def _rows(self) -> tuple[Array, Array, Array, Array, Array, NDArray[np.int64], NDArray[np.int64]]:
        """Times, motion, noise and columns of all records' blocks in one, where each record ends, and its columns' places."""
        width = max(map(len, self.places))
        ends = np.cumsum([len(x) for x in self.columns])
        columns, places = np.zeros((ends[-1], 1 + width)), np.full((len(ends), width), -1)
        for end, x, place, own in zip(ends, self.columns, self.places, places, strict=True):
            columns[end - len(x) : end, : x.shape[1]] = x
            own[: len(place)] = place
        times, noise = (
            np.concatenate([getattr(b, name) for b in self.blocks]) for name in ("times", "noise")
        )
        left, turns = (
            np.concatenate([getattr(b.sliding, name) for b in self.blocks]) for name in ("left", "turns")
        )
        return times, left, turns, noise, columns, ends, places


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One noise model tried, with q/r as `ratio`: the parameters' best change (P + ΣQ,) and covariance under it.

    `variance` is r, `deviance` -2 ln of the restricted likelihood.
    """

    ratio: float
    change: Array
    covariance: Array
    variance: float
    deviance: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile:
    """The likelihood of disturbances: the best one, and trials around it with their weights.

    `likelihood_ratio` is twice what its ln L is above that of none at all.
    """

    disturbance: Disturbance
    best: Trial
    trials: tuple[Trial, ...]
    weights: Array
    likelihood_ratio: float

    @property
    def wander(self) -> tuple[float, float]:
        """The 95 % interval of `Disturbance.wander`: where the likelihood is within a factor e^(-1.92) of the best."""
        near = [t for t in self.trials if t.deviance <= self.best.deviance + 3.84]
        q = [t.ratio * t.variance for t in near]
        low, high = (float(np.sqrt(0.5 * x * self.disturbance.tau)) for x in (min(q), max(q)))
        return low, high

    def widen(self, covariance: Array) -> Array:
        """Return a covariance (P, P) of the best parameters with the doubt about the noise model added.

        Σ w (C + δ δ') over the trials, δ the change of the parameters from the best trial to that one: the variance of a mixture.
        """
        size = len(covariance)
        own = np.diag(self.best.covariance)[:size]
        mean = sum(w * np.diag(t.covariance)[:size] for w, t in zip(self.weights, self.trials, strict=True))
        scale = np.sqrt(np.where(own > 0, mean / np.where(own > 0, own, 1.0), 1.0))
        moved = np.array([t.change[:size] - self.best.change[:size] for t in self.trials])
        return np.asarray(
            covariance * np.outer(scale, scale) + (moved * self.weights[:, None]).T @ moved, dtype=np.float64
        )


def profile(near: Linearisation, tau: float, around: float | None = None) -> Profile:
    """Return how likely disturbances are for records near a point of the parameters, for a given τ [s].

    The restricted likelihood (Patterson and Thompson 1971), -2 ln L = (n - p) ln r + Σ ln S + ln |J'S⁻¹J| with r profiled,
    allows for the parameters having been fitted. It is taken on a grid of ln(q/r), then on a finer one that spans what is
    likely; `around` is the ln(q/r) of an earlier answer.
    No disturbance is on the edge of what can be, so the likelihood ratio exceeds 2.71 in at most 5 % of the records without
    one, and 5.41 in 1 % (Self and Liang 1987).
    """
    levels = near.levels(tau) if around is None else around + 2.5 * np.array([-1.0, 0.0, 1.0])
    best, sd = _mode(near, tau, levels)
    fine = np.minimum(best + _WIDE * sd * _FINE, near.highest_level)
    without, *trials = near.under_each(tau, np.append(0.0, np.exp(fine)))
    deviances = np.array([trial.deviance for trial in trials])
    top = trials[int(np.argmin(deviances))]
    weights = np.exp(-0.5 * (deviances - deviances.min()))
    return Profile(
        disturbance=Disturbance(tau=tau, ratio=top.ratio, variance=top.variance),
        best=top,
        trials=tuple(trials),
        weights=weights / weights.sum(),
        likelihood_ratio=without.deviance - top.deviance,
    )


def _mode(near: Linearisation, tau: float, levels: Array) -> tuple[float, float]:
    """The ln(q/r) of the lowest deviance, and its standard deviation from the curvature there (at most 3)."""

    def deviances(*levels: float) -> list[float]:
        return [trial.deviance for trial in near.under_each(tau, np.exp(levels))]

    costs = deviances(*levels)
    at = int(np.argmin(costs))
    middle, width, low = float(levels[at]), float(levels[1] - levels[0]), costs[at]
    curvature = 0.0
    while width > 0.3:
        width /= 2
        left, right = deviances(middle - width, middle + width)
        curvature = (left - 2 * low + right) / width**2
        if left < low or right < low:
            middle, low = (middle - width, left) if left < right else (middle + width, right)
            width *= 1.5
    return middle, float(np.clip(np.sqrt(2 / curvature), 0.05, 3.0)) if curvature > 0 else 3.0


def whiten(x: Array, data: Dataset, sliding: Sliding, disturbance: Disturbance) -> Array:
    """Return columns x (M,) or (M, K) as innovations of each sample, of unit variance; all of a rest weigh as one sample does."""
    samples = _samples_and_rests(data, sliding, variance_of_rest(data, disturbance))
    out, _ = _innovations(x.reshape(len(x), -1), samples, data.kind, disturbance.tau, disturbance.ratio)
    out /= np.sqrt(disturbance.variance)
    return out.reshape(x.shape)


def innovations_of_blocks(x: Array, data: Dataset, sliding: Sliding, disturbance: Disturbance) -> Array:
    """Return the innovations (B,) of a residual x (M,), averaged over blocks as for the likelihood; their scale is arbitrary."""
    blocks = blocks_of(
        data,
        sliding,
        longest_block(disturbance, disturbance.tau, data),
        variance_of_rest(data, disturbance),
    )
    return _innovations(blocks.means(x[:, None]), blocks, data.kind, disturbance.tau, disturbance.ratio)[0][
        :, 0
    ]


def innovation_sd(data: Dataset, sliding: Sliding, disturbance: Disturbance) -> Array:
    """Return the standard deviation of each sample's innovation (M,) [unit of the output]."""
    n = len(data.t_output)
    _, spread = _innovations(
        np.empty((n, 0)), _samples(data, sliding), data.kind, disturbance.tau, disturbance.ratio
    )
    return np.asarray(np.sqrt(disturbance.variance * spread), dtype=np.float64)


def of_each_sample(
    disturbance: Disturbance, residuals: Sequence[Array], data: Sequence[Dataset], sliding: Sequence[Sliding]
) -> Disturbance:
    """Return the disturbance of the same q with the r of single samples, where rounding has all its power.

    Those of a shaft at rest, which all have one rounding error, say nothing of r; without any others, or where a shaft that is
    blocked leaves nothing over, it stays as it is.
    """
    estimate, q = disturbance, disturbance.ratio * disturbance.variance
    moving = [s.left > 0 for s in sliding]
    for _ in range(5):
        squares = sum(
            float(np.sum(whiten(r, d, s, estimate)[m] ** 2))
            for r, d, s, m in zip(residuals, data, sliding, moving, strict=True)
        )
        if squares == 0:
            break
        variance = estimate.variance * squares / sum(int(m.sum()) for m in moving)
        estimate = replace(estimate, ratio=q / variance, variance=variance)
    return estimate


@dataclass(frozen=True, eq=False)
class WhitenedStructure:
    """A structure whose predictions are innovations of blocks: least squares on it is maximum likelihood under the disturbance.

    Wraps another structure; the data that go with it are `whitened_data`. A block's innovation stands in the place of its first
    sample, the other samples aren't valid. A record is known by its times, which whitening leaves alone.
    """

    structure: Structure
    disturbance: Disturbance
    data: tuple[Dataset, ...]
    blocks: tuple[Blocks, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the structure."""
        return self.structure.parameters

    @property
    def friction(self) -> bool:
        """That of the structure."""
        return self.structure.friction

    def nuisance(self, data: Dataset) -> tuple[Parameter, ...]:
        """Those of the structure."""
        return self.structure.nuisance(data)

    def bounds(self, data: Sequence[Dataset]) -> tuple[Array, Array]:
        """Those of the structure for the records as they were: whitened ones don't show when the shaft first moves.

        A time constant far below the one that the filter was made for, to which a model that isn't right may slide, would take
        many steps of an integration. A search for another filter may go on from there.
        """
        lower, upper = (end.copy() for end in self.structure.bounds(self.data))
        at = [parameter.name for parameter in self.parameters].index("time_constant")
        lower[at] = max(lower[at], _SHORTEST * self.disturbance.tau)
        return lower, upper

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Those of the structure."""
        return self.structure.guesses(data)

    @property
    def held_at_first(self) -> NDArray[np.bool_]:
        """None of the parameters (P,): a search begins where another one ended."""
        return np.zeros(len(self.parameters), dtype=bool)

    def move(self, theta: Array, change: Array) -> Array:
        """That of the structure, for theta and a change of it (P + ΣQ,)."""
        return Layout(self.structure, self.data).move(theta, change)

    def predict(self, theta: Array, data: Dataset) -> Prediction:
        """Return the innovations of the prediction and of its Jacobian for theta (P + Q,), the filter held fixed."""
        plain, record = self.structure.predict(theta, data), self._record(data)
        sliding = plain.sliding or partial(self.structure.sliding, theta, data)
        both = self._filter_columns(np.column_stack([plain.y - record.y, plain.jacobian]), sliding, data)
        valid = np.zeros(len(plain.y), dtype=bool)
        valid[self._blocks(data).starts] = True
        return Prediction(y=both[:, 0], jacobian=both[:, 1:], valid=valid)

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return the innovations (M, E) of what the structure knows that it may be wrong by, for theta (P + Q,)."""
        unmodelled = self.structure.unmodelled(theta, data)
        return self._filter_columns(unmodelled, partial(self.structure.sliding, theta, data), data)

    def transfer_function(self, theta: Array, output: Output, data: Dataset) -> TransferFunction:
        """That of the structure, for theta (P + Q,)."""
        return self.structure.transfer_function(theta, output, data)

    @property
    def whitened_data(self) -> tuple[Dataset, ...]:
        """The records with zeros in place of the outputs: a prediction is the innovations of what it is off by."""
        return tuple(replace(record, y=np.zeros_like(record.y), quantum=None) for record in self.data)

    def sliding(self, theta: Array, data: Dataset) -> Sliding:
        """That of the structure, for theta (P + Q,)."""
        return self.structure.sliding(theta, data)

    def _blocks(self, data: Dataset) -> Blocks:
        return next(
            b for b, record in zip(self.blocks, self.data, strict=True) if record.t_output is data.t_output
        )

    def _record(self, data: Dataset) -> Dataset:
        return next(record for record in self.data if record.t_output is data.t_output)

    def _filter_columns(self, x: Array, sliding: Callable[[], Sliding], data: Dataset) -> Array:
        """Columns x (M, K) as innovations of unit variance at the first samples of the blocks, zero elsewhere.

        The shaft turns back where it does in the prediction: columns that turn elsewhere would seem to say much in between.
        """
        blocks, noise = self._blocks(data), self.disturbance
        if self.structure.friction:
            blocks = blocks.turning_as(sliding())
        innovations, _ = _innovations(blocks.means(x), blocks, data.kind, noise.tau, noise.ratio)
        out = np.zeros_like(x)
        out[blocks.starts] = innovations / np.sqrt(noise.variance)
        return out


def longest_block(disturbance: Disturbance | None, tau: float, data: Dataset, quick: float = _QUICK) -> float:
    """Return how long [s] a block of a record may be: short compared with τ, and with the filter's memory if that is known.

    `quick` is the part of the memory. A block of a whole one is right for the size of the disturbance, as rounding is white over
    it; but with it the parameters depend on where the blocks happen to begin, by up to 0.9 of a standard deviation.

    In a closed loop it is one sample. The mean of more would be predicted from an input that answers within the block to what
    disturbs it, and the parameters would be drawn to those of the controller.
    """
    if data.closed_loop:
        return data.sample_time
    memory = np.inf if disturbance is None else disturbance.memory(data.kind, data.sample_time)
    return float(min(_SHORT * tau, quick * memory))


def _innovations(x: Array, blocks: Blocks, kind: Kind, tau: float, ratio: float) -> tuple[Array, Array]:
    """Columns (B, K) as innovations over √S, and the variances S (B,), for r = 1."""
    from servobench.identification.estimators import kernels

    out = np.array(x, dtype=np.float64, order="C")
    spread = np.empty(len(out))
    position = 1.0 if kind == "position" else 0.0
    kernels.innovations(
        blocks.times,
        tau,
        ratio,
        blocks.sliding.left,
        blocks.sliding.turns,
        blocks.noise,
        position,
        1.0 - position,
        out,
        spread,
    )
    return out, spread

"""A first guess for first-order structures: a search over the time constant and the delay, the rest by least squares.

For a given τ, d and direction of motion, the output is linear in K, K u₀, K u_c and the start state. So a coarse grid over τ
and d, with a linear least-squares problem at each point, finds the region of the global minimum and can't diverge. A few
hundred samples of each record are enough.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.identification.models.base import Structure
from servobench.identification.models.common_parameters import COULOMB, OFFSET, ONE_WAY
from servobench.identification.models.motion import check_moves, directions
from servobench.recordings.measurement.base import Kind
from servobench.recordings.measurement.dataset import Dataset

_ROWS = 240  # a guess needs no more samples of a record than this
_AT_ONCE = 2**17  # numbers that go through a chain at once: what a processor's cache holds
_TAUS = 24
_DELAYS = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0])  # in sample times
_EARLY = np.array([-1.5, -0.5])  # samples: a row or two that are written late
_PARTS = np.array([-0.5, -0.25, 0.25, 0.5])  # of a step of the grid of τ
_LOWER = 1.0 - 1e-6  # times: under one level any width explains as much, and rounding must not decide
_WIDTHS = np.linspace(
    0.05, 0.65, 7
)  # of the largest input: dead zones that are tried for a guess of friction
_BESIDE = np.array([-0.05, 0.05])  # of the largest input: half the way to the next of them
_VALLEYS = 3
_DECADE = 10.0
_NEARLY_ALL = 1e-6  # of the output's variation left over: 99.9 % explained
_NEAR = 4.0  # a valley is worth a search of its own if its cost is within this factor of the lowest


@dataclass(frozen=True, eq=False)
class _Trials:
    """Points (T, 2) of τ and d, their costs (T,), and the least-squares coefficients (T, S + R O), shared ones first."""

    points: Array
    costs: Array
    linear: Array

    def one(self, n: int) -> _Trial:
        """Trial number n by itself."""
        tau, delay = self.points[n]
        return _Trial(float(self.costs[n]), float(tau), float(delay), self.linear[n])


@dataclass(frozen=True, eq=False)
class _Trial:
    """One point of τ and d: its cost, and the least-squares coefficients."""

    cost: float
    tau: float
    delay: float
    linear: Array


class Separable(Structure, Protocol):
    """A first-order structure as the search needs it: the indices of its parameters in the kernel's vector."""

    @property
    def columns(self) -> NDArray[np.int64]:
        """The indices of the parameters in the kernel's vector (K, τ, u₀, u_c, d)."""
        ...

    @property
    def columns_with_start(self) -> Mapping[Kind, NDArray[np.int64]]:
        """The same with the start state (θ₀, ω₀) of a record of that kind."""
        ...

    @property
    def linear_columns(self) -> NDArray[np.int64]:
        """The indices of those parameters in which the output is linear for a known direction of motion: (S,), ascending."""
        ...


def separable_guesses(structure: Separable, data: Sequence[Dataset]) -> list[tuple[float, Array]]:
    """Return costs and vectors of parameters and nuisance parameters of each record, the best first, from a search over τ and d.

    Where the cost has several minima along τ that come near each other, each of them gives a guess (3 at the most).
    Raises `NotIdentifiable` where the output doesn't move or there are too few samples.
    """
    records, minima = _search(structure, data)
    # A step of the input at the very first sample has no derivative by a delay of exactly zero.
    least = 0.1 * min(record.sample_time for record in data)
    return [
        (trial.cost, _vector(structure, records, trial, least))
        for trial in minima
        if trial.cost <= _NEAR * minima[0].cost
    ]


def guess_with_delay(structure: Separable, data: Sequence[Dataset], lowest: float) -> list[Array]:
    """Return the best guess of a grid over τ and d, where that without a delay (at a cost `lowest`) leaves much and this less.

    Where an input changes within a time constant, a motor that lags by a period less lies in a valley without a delay. Where the
    rows are as far apart as a time constant, one that has answered to the input of its own row lies in a valley of its own.
    """
    if lowest <= _NEARLY_ALL * sum(_variation(record.y) for record in data):
        return []
    records = [_Record.of(structure, record) for record in data]
    step, points = max(record.sample_time for record in data), _on_a_grid(data)
    trials = _trials(structure, records, _with_delays(points, step))
    best = trials.one(int(np.argmin(trials.costs)))
    late = _refine(structure, records, best, step, points[1, 0] / points[0, 0])
    return [_vector(structure, records, late, _EARLY[0] * step)] if late.cost < lowest else []


def _search(structure: Separable, data: Sequence[Dataset]) -> tuple[list[_Record], list[_Trial]]:
    """The records, and the best trial of each valley along τ, the lowest first."""
    for record in data:
        check_moves(record, len(structure.parameters))
    records = [_Record.of(structure, record) for record in data]
    step, points = max(record.sample_time for record in data), _on_a_grid(data)
    ratio = points[1, 0] / points[0, 0]
    trials = _trials(structure, records, points)
    minima = [_refine(structure, records, trial, step, ratio) for trial in _valleys(trials)]
    minima.sort(key=lambda trial: trial.cost)
    if not minima or not np.isfinite(minima[0].cost):
        raise NotIdentifiable("no first-order model fits these data; look at them with `servobench inspect`")
    return records, minima


def _variation(y: Array) -> float:
    """The sum of squares of an output (M,) about its mean, for as many samples as a guess uses."""
    return float(np.var(y)) * min(len(y), _ROWS)


def _with_delays(points: Array, step: float) -> Array:
    """Each τ with all of the delays but none, (T D, 2), so that those of one τ share its exponentials; `step` [s] is a sample.

    Of rows that are written after their input acted the delay is below zero.
    """
    taus = points[:, 0]
    delays = step * np.append(_EARLY, _DELAYS[1:])
    return np.column_stack([np.repeat(taus, len(delays)), np.tile(delays, len(taus))])


def is_held(data: Sequence[Dataset]) -> bool:
    """Return whether a shaft stands still in at least one sample in fifty although its input isn't off."""
    standstills = [
        (directions(record) == 0.0) & (np.abs(record.input_at_output) > 0.02 * np.abs(record.u).max())
        for record in data
    ]
    return bool(np.mean(np.concatenate(standstills)) > 0.02)


def guess_behind_dead_zone(
    structure: Separable, friction: int, data: Sequence[Dataset]
) -> tuple[float, Array]:
    """Return the best guess for a shaft that friction holds until its input has grown, and its cost.

    While it turns one way, friction takes as much of the input all the time: it moves as if behind a dead zone of that width, of
    which a few are tried, and then those beside the best: one as wide as a level that holds the shaft is at a kink, from which
    a search doesn't find its way. `structure` is that without friction, `friction` the place where its parameter belongs.
    """
    largest = max(float(np.abs(record.u).max()) for record in data)
    best, lowest = 0.0, np.inf
    for widths in (_WIDTHS, _BESIDE):
        for width in best + largest * widths:
            records = [_Record.of(structure, _behind_dead_zone(record, width)) for record in data]
            cost = float(np.min(_trials(structure, records, _on_a_grid(data)).costs))
            if cost < _LOWER * lowest:
                best, lowest = float(width), cost
    cost, guess = separable_guesses(structure, [_behind_dead_zone(record, best) for record in data])[0]
    return cost, np.insert(guess, friction, best)


def _on_a_grid(data: Sequence[Dataset]) -> Array:
    """Points (T, 2) of τ from half a sample to half a record, without a delay."""
    longest = max(record.duration for record in data)
    step = max(record.sample_time for record in data)
    shortest = 0.5 * step
    taus = shortest * (max(0.5 * longest, 2 * step) / shortest) ** np.linspace(0.0, 1.0, _TAUS)
    return np.column_stack([taus, np.zeros(_TAUS)])


def _behind_dead_zone(data: Dataset, width: float) -> Dataset:
    """A record with what a dead zone of that width [unit of the input] lets through of its input."""

    def beyond_zone(u: Array) -> Array:
        return np.asarray(np.sign(u) * np.maximum(np.abs(u) - width, 0.0), dtype=np.float64)

    return replace(data, u=beyond_zone(data.u), input_before=float(beyond_zone(np.array(data.input_before))))


def _valleys(trials: _Trials) -> list[_Trial]:
    """The local minima of the cost along τ, the three lowest of those that aren't ripples of one another.

    Where the data say little of τ, the floor of a valley is rough, and three places on it would lead to the same minimum while
    another valley, as good but for chance, is never entered.
    """
    costs = np.concatenate([[np.inf], trials.costs, [np.inf]])
    low = np.flatnonzero((costs[1:-1] <= costs[:-2]) & (costs[1:-1] <= costs[2:]) & np.isfinite(costs[1:-1]))
    valleys: list[int] = []
    for n in low[np.argsort(trials.costs[low])]:
        if not any(_is_ripple(trials, int(n), other) for other in valleys):
            valleys.append(int(n))
    return [trials.one(n) for n in valleys[:_VALLEYS]]


def _is_ripple(trials: _Trials, one: int, other: int) -> bool:
    """Whether two local minima lie near each other without a rise between them that chance wouldn't make."""
    first, last = sorted((one, other))
    near = trials.points[last, 0] < _DECADE * trials.points[first, 0]
    return bool(near and trials.costs[first : last + 1].max() < trials.costs[one] * (1 + 1 / _ROWS))


def _refine(
    structure: Separable, records: Sequence[_Record], trial: _Trial, step: float, ratio: float
) -> _Trial:
    """The best of a trial and its neighbours in τ and d, `step` the sample time and `ratio` that of the grid of τ."""
    for finer in (1.0, 0.25):
        points = np.empty((len(_DELAYS) + len(_PARTS), 2))
        points[: len(_DELAYS), 0], points[: len(_DELAYS), 1] = trial.tau, _DELAYS * step
        points[len(_DELAYS) :, 0], points[len(_DELAYS) :, 1] = (
            trial.tau * ratio ** (finer * _PARTS),
            trial.delay,
        )
        trials = _trials(structure, records, points)
        best = trials.one(int(np.argmin(trials.costs)))
        trial = best if best.cost < trial.cost else trial
    return trial


def start_guess(structure: Separable, theta: Array, data: Dataset) -> Array:
    """Return the nuisance parameters (Q,) that suit a record best with parameters theta (P,) held, by least squares.

    The direction of motion is taken from the data, so that the output is linear in the start state.
    Raises `NotIdentifiable` where the output doesn't move or there are too few samples.
    """
    from servobench.identification.models import kernels

    check_moves(data, len(structure.parameters))
    record, p = _Record.of(structure, data), np.zeros(kernels.COLUMNS)
    p[structure.columns] = theta
    lost = np.array([1.0, p[kernels.OFFSET], np.copysign(p[kernels.COULOMB], p[kernels.GAIN])])
    among = [kernels.GAIN, kernels.OFFSET, kernels.COULOMB]
    shared = p[kernels.GAIN] * lost[[among.index(c) for c in structure.linear_columns]]
    (moments,) = record.moments(p[None, [kernels.TAU, kernels.DELAY]])
    own = slice(len(shared), -1)
    left = moments[own, -1] - moments[own, : len(shared)] @ shared
    return record.own(np.linalg.lstsq(moments[own, own], left, rcond=None)[0])


def _rows(keep: NDArray[np.int64]) -> NDArray[np.int64]:
    """At most `_ROWS` of the samples, spread evenly but not regularly, so that no period of the input falls in with them."""
    if len(keep) <= _ROWS:
        return keep
    k = np.arange(_ROWS)
    within = k * 0.6180339887498949 % 1.0
    return keep[((k + within) * (len(keep) / _ROWS)).astype(np.int64)]


@dataclass(frozen=True, eq=False)
class _Record:
    """A record as a linear least-squares problem, A x = y, for any τ and d.

    `columns` (S + O,) of the kernel's vector are what the output is linear in: those that are shared, then the start state.
    `input_changes` and `sense_changes` are those of the input and of the direction of motion, with their times. Of a record
    behind a chain all samples go through it; `rows` (R,) are those of `t` (M,) that are used, `y` (R,) their values.
    The angles are counted from `zero`, that at the first sample, which keeps the moments small.
    """

    data: Dataset
    columns: NDArray[np.int64]
    nuisance: int
    input_changes: tuple[Array, Array]
    sense_changes: tuple[Array, Array]
    t: Array
    rows: NDArray[np.int64]
    y: Array
    zero: float

    @classmethod
    def of(cls, structure: Separable, data: Dataset) -> _Record:
        """The record as a structure needs it."""
        from servobench.identification.models.records import is_plain

        plain = is_plain(data)
        used = _rows(np.arange(len(data.y)) if plain else np.flatnonzero(data.valid))
        changes = data.u != np.append(data.input_before, data.u[:-1])
        sense = directions(data) if structure.friction else np.empty(0)
        turns = np.ones(len(sense), dtype=bool)
        turns[1:] = sense[1:] != sense[:-1]
        zero = float(data.y[0]) if plain and data.kind == "position" else 0.0
        start = structure.columns_with_start[data.kind][len(structure.parameters) :]
        return cls(
            data=data,
            columns=np.append(structure.linear_columns, start),
            nuisance=len(structure.nuisance(data)),
            input_changes=(data.t_input[changes], data.u[changes]),
            sense_changes=(data.t_output[: len(turns)][turns], sense[turns]),
            t=data.t_output[used] if plain else data.t_output,
            rows=np.arange(len(used)) if plain else used,
            y=data.y[used] - zero,
            zero=zero,
        )

    def moments(self, points: Array) -> Array:
        """Return [A y]'[A y] (T, S + O + 1, S + O + 1) for points (T, 2) of τ and d; S columns are shared, O the record's own."""
        at_once = max(_AT_ONCE // (len(self.columns) * len(self.t)), 1)
        parts = [self._moments(points[n : n + at_once]) for n in range(0, len(points), at_once)]
        return np.concatenate(parts)

    def own(self, linear: Array) -> Array:
        """Return the record's nuisance parameters for its coefficients (O or more,): start state, and those of the filters."""
        own = linear[: self.nuisance].copy()
        own[0] += self.zero
        return own

    def _moments(self, points: Array) -> Array:
        """Those of a few points."""
        from servobench.identification.models import kernels
        from servobench.identification.models.records import is_plain

        data, plain = self.data, is_plain(self.data)
        columns = kernels.separable_columns(
            *self.input_changes,
            data.input_before,
            *self.sense_changes,
            points + np.array([0.0, data.delay]),
            self.t,
            float((data.kind if plain else data.shaft_kind) == "speed"),
            self.columns,
        )
        own = np.empty((0, len(self.rows)))
        with np.errstate(over="ignore", invalid="ignore"):  # as in `records.through_chain`
            if not plain:
                passed = data.chain.linear(columns.reshape(-1, len(self.t)).T, data.t_output)[self.rows]
                columns, own = passed.T.reshape(*columns.shape[:2], -1), data.start_responses[self.rows].T
            both = np.vstack([own, self.y])
            block = np.concatenate([columns, np.broadcast_to(both, (len(points), *both.shape))], axis=1)
            return np.asarray(block @ block.transpose(0, 2, 1))


def _trials(structure: Separable, records: Sequence[_Record], points: Array) -> _Trials:
    """Least squares over what is linear, at points (T, 2) of τ and d."""
    from servobench.identification.models import kernels

    moments = [record.moments(points) for record in records]
    shared, width = len(structure.linear_columns), max(m.shape[1] for m in moments)
    joint = np.zeros((len(records), len(points), width, width))
    for m, into in zip(moments, joint, strict=True):
        # Own columns that this record lacks stay zero, between those it has and y.
        own = m.shape[1] - 1
        into[:, :own, :own], into[:, :own, -1] = m[:, :-1, :-1], m[:, :-1, -1]
        into[:, -1, :own], into[:, -1, -1] = m[:, -1, :-1], m[:, -1, -1]
    linear = np.empty((len(points), shared + len(records) * (width - shared - 1)))
    costs = np.empty(len(points))
    kernels.separate_costs(joint, shared, costs, linear)
    costs[(linear[:, 0] == 0) | ~np.isfinite(costs)] = np.inf
    return _Trials(points, costs, linear)


def _vector(structure: Separable, records: Sequence[_Record], trial: _Trial, least: float) -> Array:
    """The whole parameter vector that a trial stands for, with a delay of `least` [s] or more."""
    gain = float(trial.linear[0])
    values = {"gain": gain, "time_constant": trial.tau, "delay": max(trial.delay, least)}
    column = 1
    for parameter in (OFFSET, ONE_WAY, COULOMB):
        if parameter in structure.parameters:
            # Friction brakes, whichever way the wires are: of a negative gain it takes what a positive one does.
            value = float(trial.linear[column]) / (abs(gain) if parameter is COULOMB else gain)
            values[parameter.name] = float(np.clip(value, parameter.lower, parameter.upper))
            column += 1
    own = trial.linear[column:].reshape(len(records), -1)
    start = [record.own(linear) for record, linear in zip(records, own, strict=True)]
    return np.concatenate([[values[parameter.name] for parameter in structure.parameters], *start])

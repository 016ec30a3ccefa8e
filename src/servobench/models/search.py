"""A first guess for first-order structures: a search over the time constant and the delay, the rest by least squares.

For a given τ, d and direction of motion, the output is linear in K, K u₀, K u_c and the start state. So a coarse grid over
τ and d, with a linear least-squares problem at each point, finds the region of the global minimum without any step that
could diverge. A few hundred samples of each record are enough for that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array
from servobench.errors import NotIdentifiable
from servobench.measurement.dataset import Dataset

if TYPE_CHECKING:
    from servobench.models.first_order import FirstOrder

_ROWS = 240  # a guess needs no more samples of a record than this
_TAUS = 24
_DELAYS = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0])  # in sample times
_PARTS = np.array([-0.5, -0.25, 0.25, 0.5])  # of a step of the grid of τ
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


class _Record(Protocol):
    """A record as a linear least-squares problem, A x = y, for any τ and d."""

    def moments(self, points: Array) -> Array:
        """Return [A y]'[A y] (T, S + O + 1, S + O + 1) for points (T, 2) of τ and d; S columns are shared, O the record's own."""
        ...

    def own(self, linear: Array) -> Array:
        """Return the record's nuisance parameters for its coefficients (O or more,)."""
        ...


def separable_guesses(structure: FirstOrder, data: Sequence[Dataset]) -> list[Array]:
    """Return vectors of parameters and nuisance parameters of each record, the best first, from a search over τ and d.

    Where the cost has several minima along τ that come near each other, each of them gives a guess (3 at the most).
    Raises `NotIdentifiable` where the output doesn't move or there are too few samples.
    """
    for record in data:
        check_moves(record, len(structure.parameters))
    records = [_record(structure, record) for record in data]
    longest = max(record.duration for record in data)
    steps = [record.sample_time for record in data]
    step = max(steps)
    shortest = 0.5 * step
    taus = shortest * (max(0.5 * longest, 2 * step) / shortest) ** np.linspace(0.0, 1.0, _TAUS)
    trials = _trials(structure, records, np.column_stack([taus, np.zeros(_TAUS)]))
    found = [_refined(structure, records, trial, step, taus[1] / taus[0]) for trial in _valleys(trials)]
    found.sort(key=lambda trial: trial.cost)
    if not found or not np.isfinite(found[0].cost):
        raise NotIdentifiable(
            "no first-order model comes near these data; look at them with `servobench inspect`"
        )
    # A step of the input at the very first sample has no derivative by a delay of exactly zero.
    least = 0.1 * min(steps)
    return [
        _vector(structure, records, trial, least) for trial in found if trial.cost <= _NEAR * found[0].cost
    ]


def _valleys(trials: _Trials) -> list[_Trial]:
    """The local minima of the cost along τ, the three lowest."""
    costs = np.concatenate([[np.inf], trials.costs, [np.inf]])
    low = np.flatnonzero((costs[1:-1] <= costs[:-2]) & (costs[1:-1] <= costs[2:]) & np.isfinite(costs[1:-1]))
    return [trials.one(int(n)) for n in low[np.argsort(trials.costs[low])][:3]]


def _refined(
    structure: FirstOrder, records: Sequence[_Record], trial: _Trial, step: float, ratio: float
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


def directions(data: Dataset) -> Array:
    """Return the direction of motion at each output sample, -1, 0 or 1, from the smoothed speed, shape (M,)."""
    speed = smoothed_speed(data)
    scale = float(np.percentile(np.abs(speed), 95))
    return np.where(np.abs(speed) > 0.02 * scale, np.sign(speed), 0.0)


def turns_both_ways(data: Sequence[Dataset]) -> bool:
    """Return whether at least one sample in fifty was taken while the motor turned the other way."""
    senses = np.concatenate([directions(record) for record in data])
    return bool(min(np.mean(senses > 0), np.mean(senses < 0)) > 0.02)


def smoothed_speed(data: Dataset) -> Array:
    """Return a speed for orientation only, in the unit of the position a second, shape (M,).

    A position is differenced over the shortest span in which a step of the encoder is below a twentieth of the motion.
    """
    y, t = data.y, data.t_output
    if data.kind == "speed":
        return y
    span = 1
    limit = max(1, len(y) // 20)
    quantum = data.quantum or 0.0
    while span < limit:
        moved = np.abs(y[span:] - y[:-span])
        enough = np.count_nonzero(moved > 20 * quantum) > 0.1 * len(moved)
        if enough and np.count_nonzero(moved) > 0.5 * len(moved):
            break
        span = min(2 * span, limit)
    index = np.arange(len(y))
    after, before = np.minimum(index + span, len(y) - 1), np.maximum(index - span, 0)
    return (y[after] - y[before]) / (t[after] - t[before])


def check_moves(data: Dataset, parameters: int) -> None:
    """Raise `NotIdentifiable` where a record has too few samples for so many parameters, or its output never moves."""
    needed = 2 * parameters + 4
    if len(data.y) < needed:
        raise NotIdentifiable(
            f"{data.name}: {len(data.y)} samples of the output; at least {needed} are needed: record for longer"
        )
    if np.ptp(data.y) == 0:
        raise NotIdentifiable(
            f"{data.name}: the output stays at {data.y[0]:g} {data.output_unit} throughout: the wheel was blocked, the encoder "
            "isn't connected, or another column was meant; record the motor while it turns"
        )


def _shared(structure: FirstOrder) -> NDArray[np.int64]:
    """The kernel's columns of what all records share and the output is linear in."""
    from servobench.models import kernels
    from servobench.models.first_order import COULOMB, OFFSET, ONE_WAY

    columns = [kernels.GAIN]
    if any(parameter in (OFFSET, ONE_WAY) for parameter in structure.parameters):
        columns.append(kernels.OFFSET)
    if COULOMB in structure.parameters:
        columns.append(kernels.COULOMB)
    return np.array(columns)


def _rows(keep: NDArray[np.int64]) -> NDArray[np.int64]:
    """At most `_ROWS` of the samples, spread evenly but not regularly, so that no period of the input falls in with them."""
    if len(keep) <= _ROWS:
        return keep
    k = np.arange(_ROWS)
    within = k * 0.6180339887498949 % 1.0
    return keep[((k + within) * (len(keep) / _ROWS)).astype(np.int64)]


def _record(structure: FirstOrder, data: Dataset) -> _Record:
    from servobench.models.first_order import COULOMB
    from servobench.models.records import is_plain

    sense = directions(data) if COULOMB in structure.parameters else np.empty(0)
    return _Plain.of(structure, data, sense) if is_plain(data) else _Chained(structure, data, sense)


@dataclass(frozen=True, eq=False)
class _Plain:
    """A record of the shaft itself: the changes of the input and of the direction of motion, and the samples that are used.

    The angles are counted from that at the first sample, which keeps the moments small.
    """

    shared: NDArray[np.int64]
    nuisance: NDArray[np.int64]
    data: Dataset
    input_changes: tuple[Array, Array]
    sense_changes: tuple[Array, Array]
    t: Array
    y: Array
    zero: float

    @classmethod
    def of(cls, structure: FirstOrder, data: Dataset, sense: Array) -> _Plain:
        rows = _rows(np.arange(len(data.y)))
        changes = data.u != np.append(data.input_before, data.u[:-1])
        turns = np.ones(len(sense), dtype=bool)
        turns[1:] = sense[1:] != sense[:-1]
        zero = float(data.y[0]) if data.kind == "position" else 0.0
        return cls(
            shared=_shared(structure),
            nuisance=structure.columns_with_start[data.kind][len(structure.parameters) :],
            data=data,
            input_changes=(data.t_input[changes], data.u[changes]),
            sense_changes=(data.t_output[: len(turns)][turns], sense[turns]),
            t=data.t_output[rows],
            y=data.y[rows] - zero,
            zero=zero,
        )

    def moments(self, points: Array) -> Array:
        """Those of the samples that are used."""
        from servobench.models import kernels

        data = self.data
        return kernels.separable_moments(
            *self.input_changes,
            data.input_before,
            *self.sense_changes,
            points + np.array([0.0, data.delay]),
            self.t,
            self.y,
            float(data.kind == "speed"),
            self.shared,
            self.nuisance,
        )

    def own(self, linear: Array) -> Array:
        """The start state."""
        own = linear[: len(self.nuisance)].copy()
        own[0] += self.zero
        return own


@dataclass(frozen=True, eq=False)
class _Chained:
    """A record behind a measurement chain, through which each column goes."""

    structure: FirstOrder
    data: Dataset
    sense: Array

    def moments(self, points: Array) -> Array:
        """Those of the samples that are used."""
        blocks = [self._columns(float(tau), float(delay)) for tau, delay in points]
        return np.array([block.T @ block for block in blocks])

    def own(self, linear: Array) -> Array:
        """The start state, and those of the filters."""
        return linear[: len(self.structure.nuisance(self.data))]

    def _columns(self, tau: float, delay: float) -> Array:
        """A and y beside each other."""
        from servobench.models.first_order import COULOMB, DELAY, GAIN, OFFSET, TIME_CONSTANT, FirstOrder

        unit, data = FirstOrder((GAIN, TIME_CONSTANT, OFFSET, DELAY)), self.data
        theta = np.zeros(len(unit.parameters) + len(unit.nuisance(data)))
        theta[:4] = (1.0, tau, 0.0, delay)
        plain = unit.predict(theta, data)
        shared = [plain.jacobian[:, 0]]
        if len(_shared(self.structure)) > 1 + (COULOMB in self.structure.parameters):
            shared.append(plain.jacobian[:, 2])
        if COULOMB in self.structure.parameters:
            sense = -self.sense
            sensed = replace(
                data,
                t_input=data.t_output,
                u=sense,
                input_before=float(sense[0]),
                delay=-delay,
                reference=None,
            )
            shared.append(unit.predict(theta, sensed).jacobian[:, 0])
        rows = _rows(np.flatnonzero(plain.valid))
        return np.column_stack([*shared, plain.jacobian[:, 4:], data.y])[rows]


def _trials(structure: FirstOrder, records: Sequence[_Record], points: Array) -> _Trials:
    """Least squares over what is linear, at points (T, 2) of τ and d."""
    from servobench.models import kernels

    moments = [record.moments(points) for record in records]
    shared, width = len(_shared(structure)), max(m.shape[1] for m in moments)
    joint = np.zeros((len(records), len(points), width, width))
    for m, into in zip(moments, joint, strict=True):
        # Own columns that this record lacks stay zero, between those it has and y.
        own = m.shape[1] - 1
        into[:, :own, :own], into[:, :own, -1] = m[:, :-1, :-1], m[:, :-1, -1]
        into[:, -1, :own], into[:, -1, -1] = m[:, -1, :-1], m[:, -1, -1]
    linear = np.empty((len(points), shared + len(records) * (width - shared - 1)))
    costs = np.empty(len(points))
    kernels.separated(joint, shared, costs, linear)
    costs[(linear[:, 0] == 0) | ~np.isfinite(costs)] = np.inf
    return _Trials(points, costs, linear)


def _vector(structure: FirstOrder, records: Sequence[_Record], trial: _Trial, least: float) -> Array:
    """The whole parameter vector that a trial stands for, with a delay of `least` [s] or more."""
    from servobench.models.first_order import COULOMB, OFFSET, ONE_WAY

    gain = float(trial.linear[0])
    found = {"gain": gain, "time_constant": trial.tau, "delay": max(trial.delay, least)}
    column = 1
    for parameter in (OFFSET, ONE_WAY, COULOMB):
        if parameter in structure.parameters:
            value = float(trial.linear[column]) / gain
            found[parameter.name] = float(np.clip(value, parameter.lower, parameter.upper))
            column += 1
    own = trial.linear[column:].reshape(len(records), -1)
    start = [record.own(linear) for record, linear in zip(records, own, strict=True)]
    return np.concatenate([[found[parameter.name] for parameter in structure.parameters], *start])

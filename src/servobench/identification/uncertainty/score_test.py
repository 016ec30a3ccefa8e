"""The score test of one fit for a term that its structure lacks: how strongly the data ask for it, and for how much of it.

The term is an extra input e(t) that depends on what the motor does, or something that the sensor adds: what it would add to the
output is a column c beside the Jacobian J. If the structure is right, the innovations r (of unit variance) have no part of c
that J can't have as well:

    t² = (C⊥'r)' (C⊥'C⊥)⁻¹ C⊥'r,   C⊥ = C - J (J'J)⁻¹ J'C

is χ² with as many degrees of freedom as the term has columns (Rao 1948). No parameter is fitted again. The rounding of an ideal
encoder is not quite white, which is why the limit lies well above what chance gives. (C⊥'C⊥)⁻¹ C⊥'r is how much of the
term the data ask for, and (J'J)⁻¹ J'C times that is how far its absence has moved the parameters: both to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.probability import chi_square_above, normal_quantile
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.covariance import andrews_lag, long_run
from servobench.identification.estimators.disturbance import whiten
from servobench.identification.estimators.encoder_rounding import is_rounded, noise_before, rounding_sines
from servobench.identification.models.base import simulate_output
from servobench.recordings.measurement.dataset import Dataset

LIMIT = 5.0  # standard deviations of a normal number that is as improbable
ASKED = 2.0  # below that the amount of a term isn't computed
SMALL: Final = 1e-4
"""Of the largest input: the size of a term's extra input, small enough for the response to be linear in it."""
_BLOCK = 0.33  # of τ: what a random torque did to the speed hardly fades within
_AT_ONCE = (
    2**15
)  # samples, over the terms whose columns are held at once: about what a processor's cache holds


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """The motion at the same times: input and speed over their largest values, position, and the elapsed part of the record.

    `gone` runs from -1 to 1; the position is in its own unit, `fastest` is the largest speed in that unit per second, and
    `acceleration` is in that unit per second squared; `load` is what gravity takes by the model, over its largest value.
    """

    input: Array
    speed: Array
    position: Array
    gone: Array
    load: Array
    acceleration: Array
    fastest: float

    @cached_property
    def _waves(self) -> list[NDArray[np.complex128]]:
        """e^(i n θ) of the position θ for n = 1, 2, ..., as far as they have been needed."""
        return [np.exp(1j * self.position)]

    def wave(self, cycles: int) -> tuple[Array, Array]:
        """Return the sine and the cosine (N,) of so many times the position, the one from that of one time less."""
        while len(self._waves) < cycles:
            self._waves.append(self._waves[-1] * self._waves[0])
        return self._waves[cycles - 1].imag, self._waves[cycles - 1].real


@dataclass(frozen=True, kw_only=True)
class Term:
    """A term that a model may lack: its finding's code, its name for people, a sentence, and what it adds for a motion.

    It is added `to_input` or `to_output`.
    `curved` is a parameter whose second derivative the term is like; `limit` is in standard deviations. `rung` is what a
    structure with the term has in its name, where there is one. `sized` says how much of the term there is, `within` whether
    that is so little that the intervals of the fit hold it as well.
    """

    code: str
    name: str
    sentence: str
    to_input: Callable[[Motion], tuple[Array, ...]] | None = None
    to_output: Callable[[Motion], tuple[Array, ...]] | None = None
    curved: str | None = None
    limit: float = LIMIT
    rung: str | None = None
    sized: Callable[[TermScore], str] | None = None
    within: Callable[[TermScore], bool] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class TermScore:
    """The strength of the data's evidence for a term (`size`, in standard deviations), and the term's amount.

    `amount` (K,) of what the term adds, in the unit of the input or of the output, with its `covariance` (K, K); `moved` is by
    how many of their own standard deviations gain or time constant, whichever is worse, are off without it, `off` (P,) is by how
    much each parameter is. `fit` is the one tested, `largest` its largest input. `columns` (N, K) are what the term adds to
    the innovations beyond what the parameters can, where the data ask for it.
    """

    term: Term
    size: float
    fit: Fit
    largest: float
    amount: Array = field(default_factory=lambda: np.zeros(0))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    moved: float = 0.0
    off: Array = field(default_factory=lambda: np.zeros(0))
    columns: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def braking(self) -> float:
        """The amount of a friction, in the input's unit and above zero where it brakes, whichever way the wires are."""
        turned = "gain" in self.fit.model.names and self.fit.model["gain"] < 0
        return float(-self.amount[0] if turned else self.amount[0])

    @property
    def whole(self) -> tuple[float, float]:
        """The size of the amount, √(a'a), and the half of its 95 % interval."""
        size = float(np.linalg.norm(self.amount))
        along = self.amount / size if size > 0 else self.amount
        variance = float(along @ self.covariance @ along)
        return size, TWO_SIDED * float(np.sqrt(max(variance, 0.0)))


class ScoreTest:
    """The score test of one fit: the parts that all terms share."""

    def __init__(self, fit: Fit, largest: float) -> None:
        self.fit = fit
        self.runs = [_Run(fit, record, largest) for record in fit.records]
        jacobian, self.innovations = innovations_and_jacobian(fit)
        self.scale = _lengths(jacobian)
        self.matters = self.scale > 0
        self.basis, self.triangle = np.linalg.qr(jacobian[:, self.matters] / self.scale[self.matters])
        self.hidden = _unresolvable_ripple(fit)

    def scores(self, terms: Sequence[Term]) -> Iterator[TermScore]:
        """The amount in the innovations of each term that these data could show; only from 2 deviations on."""
        in_radians = all(run.record.data.position_unit == "rad" for run in self.runs)
        possible = [term for term in terms if term.code != "ripple" or in_radians]
        at_once = max(_AT_ONCE // len(self.innovations), 1)
        for first in range(0, len(possible), at_once):
            yield from self._scores(possible[first : first + at_once])

    def _scores(self, terms: Sequence[Term]) -> Iterator[TermScore]:
        """The tests of a few terms, which share what is done to their columns."""
        added = [run.columns(terms) for run in self.runs]
        columns = np.concatenate([x for x, _ in added]) if len(added) > 1 else added[0][0]
        norms = _lengths(columns)
        # A term that leads beyond what any motor does, where the prediction is infinite, is none that these data could show.
        columns = np.where(np.isfinite(norms), columns, 0.0)
        rest = self.basis @ (self.basis.T @ columns)
        np.subtract(columns, rest, out=rest)
        # What is left of a column that the Jacobian explains is rounding error.
        independent = np.isfinite(norms) & (_lengths(rest) > 1e-6 * norms)
        rest /= np.where(independent, norms, 1.0)
        total, power = self.innovations @ rest, rest.T @ rest
        for n, term in enumerate(terms):
            at = np.flatnonzero(independent & (added[0][1] == n))
            white = _normal_equivalent(total[at], power[at[:, None], at]) if len(at) else 0.0
            plain = TermScore(term=term, size=white, fit=self.fit, largest=self.runs[0].largest)
            yield (
                plain if white <= ASKED else self._with_amount(plain, columns[:, at], norms[at], rest[:, at])
            )

    def _with_amount(self, plain: TermScore, columns: Array, norms: Array, rest: Array) -> TermScore:
        """The test for one term for the innovations' own colour, and its amount: white ones would call for it.

        `columns` (N, K) of that length (K,) are what it adds, `rest` (N, K) what the parameters leave of them, over the length.
        """
        term, total, power = plain.term, self.innovations @ rest, rest.T @ rest
        size, coloured = _size_of(self.fit, self.innovations, rest)
        bread = np.linalg.pinv(power) / norms
        amount = total @ bread
        if term.code == "ripple" and np.abs(rest @ (norms * amount)).max() < self.hidden:
            return replace(plain, size=0.0)
        unit = 1.0 if term.to_input is None else SMALL * self.runs[0].largest
        off = self.joint_shift(columns @ amount)
        return replace(
            plain,
            size=size,
            amount=unit * amount,
            covariance=unit**2 * bread.T @ coloured @ bread,
            moved=self._in_sd(off),
            off=off[: len(self.fit.model.theta)],
            columns=rest if size > term.limit else plain.columns,
        )

    def shift(self, lacking: Sequence[Array]) -> Array:
        """The errors of the parameters (P,) if each record's output has `lacking` (M,), which the prediction lacks."""
        columns = [
            in_innovations(self.fit, record, extra[:, None])
            for record, extra in zip(self.fit.records, lacking, strict=True)
        ]
        return self.joint_shift(np.concatenate(columns)[:, 0])[: len(self.fit.model.theta)]

    def joint_shift(self, lacking: Array) -> Array:
        """The errors of the joint vector (P + ΣQ,) if the innovations of all records lack that: (J'J)⁻¹ J' lacking."""
        off = np.zeros(len(self.scale))
        matters, projection = self.matters, self.basis.T @ lacking
        off[matters] = np.linalg.lstsq(self.triangle, projection, rcond=1e-12)[0] / self.scale[matters]
        return off

    def _in_sd(self, off: Array) -> float:
        """The larger error of gain and time constant, in standard deviations, for these errors of the joint vector (P + ΣQ,)."""
        sd = np.sqrt(np.diag(self.fit.covariance))
        names = self.fit.model.names
        at = [names.index(name) for name in ("gain", "time_constant") if name in names]
        return max((float(abs(off[n]) / sd[n]) for n in at if sd[n] > 0), default=0.0)


def size_beside(shown: TermScore, others: Sequence[TermScore]) -> float:
    """Return how strongly the data ask for a term beside others, in standard deviations.

    What the others' columns can have as well is taken out of its own (Rao 1948 with the others among the parameters).
    """
    beside = [other.columns for other in others if len(other.columns) == len(shown.columns)]
    if not beside or not shown.columns.size:
        return shown.size
    basis, _ = np.linalg.qr(np.hstack(beside))
    rest = shown.columns - basis @ (basis.T @ shown.columns)
    independent = _lengths(rest) > 1e-6 * _lengths(shown.columns)
    if not independent.any():
        return 0.0
    innovations = np.concatenate([record.innovations[record.valid] for record in shown.fit.records])
    return min(_size_of(shown.fit, innovations, rest[:, independent])[0], shown.size)


def _size_of(fit: Fit, innovations: Array, rest: Array) -> tuple[float, Array]:
    """The size of columns (N, K) in the innovations, in standard deviations, and the covariance (K, K) for the innovations'
    colour.
    """
    total = innovations @ rest
    score = rest * innovations[:, None]
    coloured = long_run(score, andrews_lag(score))
    size = min(_normal_equivalent(total, rest.T @ rest), _normal_equivalent(total, coloured))
    if size > LIMIT and fit.disturbance is None and fit.records[0].data.kind == "speed":
        size = min(size, _normal_equivalent(total, _slowly_coloured(fit, score)))
    rounded = by_rounding(fit, rest) if size > ASKED else None
    if rounded is not None:
        size = min(size, _normal_equivalent(total, rounded))
    return size, coloured


def _slowly_coloured(fit: Fit, score: Array) -> Array:
    """The long-run variance (K, K) of scores (N, K) of a speed, by sums over a third of a time constant.

    Below the noise of differenced counts, which cancels from sample to sample, a random torque doesn't show in neighbours.
    """
    tau = fit.model["time_constant"] if "time_constant" in fit.model.names else 0.0
    size = int(np.clip(_BLOCK * tau / fit.records[0].data.sample_time, 1, len(score)))
    summed = np.add.reduceat(score, np.arange(0, len(score), size))
    return long_run(summed, andrews_lag(summed))


def _unresolvable_ripple(fit: Fit) -> float:
    """The ripple in the innovations that could be encoder rounding: half a count where that repeats, else 0.

    Both depend on the angle alone. Rounding that comes again with each period of the motion isn't noise, and no average over the
    record makes it less.
    """
    if fit.disturbance is not None or all(finding.code != "rounding-repeats" for finding in fit.findings):
        return 0.0
    return max(0.5 * (record.data.quantum or 0.0) for record in fit.records) / fit.residual_sd


def _normal_equivalent(total: Array, spread: Array) -> float:
    """The normal number that is as improbable as χ² = x' S⁻¹ x, x (K,) with covariance S (K, K)."""
    from servobench.identification.estimators import symmetric

    chi2 = symmetric.chi_square(total, spread)
    return -normal_quantile(0.5 * max(chi_square_above(chi2, len(total)), 1e-300))


def _lengths(columns: Array) -> Array:
    """The length of each column (K,)."""
    return np.asarray(np.sqrt(np.einsum("mk,mk->k", columns, columns)), dtype=np.float64)


class _Run:
    """One record, simulated once without any term."""

    def __init__(self, fit: Fit, record: FittedRecord, largest: float) -> None:
        self.fit, self.record, self.largest = fit, record, largest
        self.theta = np.concatenate([fit.model.theta, record.nuisance])

    @cached_property
    def plain(self) -> Dataset:
        """The record with its input at all times of input and output, so that a term may act at each of them."""
        data = self.record.data
        if np.array_equal(data.t_input, data.t_output):
            return data if data.reference is None else replace(data, reference=None)
        times = np.union1d(data.t_input, data.t_output)
        held = np.searchsorted(data.t_input, times, side="right") - 1
        u = np.where(held >= 0, data.u[np.maximum(held, 0)], data.input_before)
        return replace(data, t_input=times, u=u, reference=None)

    @cached_property
    def without(self) -> Array:
        """The output without any term, (M,)."""
        return simulate_output(self.fit.model.structure, self.theta, self.plain)

    def columns(self, terms: Sequence[Term]) -> tuple[Array, NDArray[np.int64]]:
        """The innovations due to terms, as columns (valid, K), and the number of the term of each (K,)."""
        added = [self._output_of(term) for term in terms]
        whose = np.repeat(np.arange(len(terms)), [len(each) for each in added])
        columns = np.column_stack([column for each in added for column in each])
        return in_innovations(self.fit, self.record, columns), whose

    def _output_of(self, term: Term) -> list[Array]:
        """The output due to a term, as columns (M,)."""
        added = []
        if term.to_input is not None:
            for extra in term.to_input(self.motion):
                driving = self.plain.u + SMALL * self.largest * extra
                output = simulate_output(self.fit.model.structure, self.theta, self.plain, driving)
                added.append(output - self.without)
        if term.to_output is not None and self.record.data.kind == "position":
            data = self.record.data
            now = np.searchsorted(self.plain.t_input, data.t_output)
            added += [data.chain.linear(extra[now], data.t_output) for extra in term.to_output(self.motion)]
        if term.curved in self.fit.model.names:
            added.append(self._curvature(self.fit.model.names.index(term.curved)))
        return added or [np.zeros(len(self.record.data.y))]

    def _curvature(self, at: int) -> Array:
        """The second derivative of the output by a parameter that is a time, over a tenth of a sample time either way.

        In a closed loop a negative delay would have the input act before the sample that it answers to, so that noise looks like
        a response: there the derivative is taken from the side of longer delays where it has to be.
        """
        data, step = self.record.data, np.zeros(len(self.theta))
        step[at] = 0.1 * data.sample_time
        middle = self.theta.copy()
        if data.closed_loop:
            middle[at] = max(middle[at], step[at] - data.delay)
        after, now, before = (
            simulate_output(self.fit.model.structure, middle + times * step, data) for times in (1, 0, -1)
        )
        return np.asarray((after - 2 * now + before) / step[at] ** 2)

    @cached_property
    def motion(self) -> Motion:
        """The motion as the model simulates it, at the times of the input and the output; of a speed, the angle as measured."""
        data, t = self.record.data, self.plain.t_input
        turning = self.record.prediction
        if data.kind == "speed":
            measured = np.interp(t, data.t_output, data.y)  # the model's would be off by more with each turn
            steps = 0.5 * (measured[1:] + measured[:-1]) * np.diff(t)
            position = np.concatenate([[0.0], np.cumsum(steps)])
        else:
            position = np.interp(t, data.t_output, turning)
            turning = np.gradient(turning, data.t_output)
        speed = np.interp(t, data.t_output, turning)
        top = float(np.abs(speed).max(initial=0.0)) or 1.0
        value = dict(zip(self.fit.model.names, self.fit.model.theta, strict=True))
        sine, cosine = value.get("gravity_voltage_sine", 0.0), value.get("gravity_voltage_cosine", 0.0)
        load = np.abs(sine * np.sin(position) + cosine * np.cos(position))
        return Motion(
            input=self.plain.u / self.largest,
            speed=speed / top,
            position=position,
            load=load / (float(load.max(initial=0.0)) or 1.0),
            gone=2 * (t - t[0]) / max(float(t[-1] - t[0]), 1e-300) - 1,
            acceleration=np.interp(t, data.t_output, np.gradient(turning, data.t_output)),
            fastest=top,
        )


def by_rounding(fit: Fit, columns: Array) -> Array | None:
    """Return the covariance (C, C) of columns (N, C) times the innovations by what the encoder rounds; the model says when.

    None where not all of the records are an encoder's counts, or a random torque moves the shaft besides. The stretches of one
    recording share their counts.
    """
    if fit.disturbance is not None or not all(is_rounded(r.data) and r.valid.all() for r in fit.records):
        return None
    power = np.zeros((columns.shape[1], columns.shape[1]))
    sines: dict[int, Array] = {}
    row = 0
    for record in fit.records:
        quantum = record.data.quantum or np.nan
        own = columns[row : row + len(record.data.y)]
        row += len(own)
        noise = noise_before(fit.residual_sd, quantum)
        shared, white = rounding_sines(own, record.prediction, quantum, noise)
        power += white * (own.T @ own)
        at = id(record.data.source)
        sines[at] = sines.get(at, 0.0) + shared
    power += sum(s.T @ s for s in sines.values())
    return np.asarray(power / fit.residual_sd**2, dtype=np.float64)


def innovations_and_jacobian(fit: Fit) -> tuple[Array, Array]:
    """Return the Jacobian (N, P + ΣQ) of all valid innovations by the joint vector, and these (N,), of unit variance."""
    jacobian = _joint([_jacobian(fit, record) for record in fit.records], len(fit.model.theta))
    return jacobian, np.concatenate([record.innovations[record.valid] for record in fit.records])


def _jacobian(fit: Fit, record: FittedRecord) -> Array:
    theta = np.concatenate([fit.model.theta, record.nuisance])
    return in_innovations(fit, record, fit.model.structure.predict(theta, record.data).jacobian)


def in_innovations(fit: Fit, record: FittedRecord, x: Array) -> Array:
    """Return columns (M, K) of a record's output as columns of its innovations, the valid samples of them."""
    if fit.disturbance is None:
        counted = x if record.valid.all() else x[record.valid]
        return np.asarray(counted / fit.residual_sd, dtype=np.float64)
    theta = np.concatenate([fit.model.theta, record.nuisance])
    sliding = fit.model.structure.sliding(theta, record.data)
    white = whiten(x, record.data, sliding, fit.disturbance)
    return white if record.valid.all() else white[record.valid]


def _joint(jacobians: list[Array], shared: int) -> Array:
    """The Jacobian of all records: shared parameters in the same columns, each record's own beside them."""
    own = [jacobian.shape[1] - shared for jacobian in jacobians]
    out = np.zeros((sum(len(jacobian) for jacobian in jacobians), shared + sum(own)))
    row, place = 0, shared
    for jacobian, count in zip(jacobians, own, strict=True):
        rows = slice(row, row + len(jacobian))
        out[rows, :shared] = jacobian[:, :shared]
        out[rows, place : place + count] = jacobian[:, shared:]
        row, place = row + len(jacobian), place + count
    return out

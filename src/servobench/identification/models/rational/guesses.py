"""Guesses for rational structures: state-variable filters first, then refined instrumental variables.

With a filter 1/Λ of the order of A in place of derivatives, A y = B u is a linear regression (Garnier and Wang 2008, chapter 1).
An instrument, the noise-free output of the current model, and the filter 1/A of that model remove the bias due to output noise
(Young and Jakeman 1980). Here the columns of the instruments are exact, with the delay, the start state and the measurement
chain. So they are the Jacobian of the simulated output, the equation error is the simulation's error, and the iteration
converges to the minimum of the squared simulation error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.identification.models.base import Prediction, Structure
from servobench.identification.models.rational.response import filter_derivatives, linear_pieces
from servobench.recordings.measurement.dataset import Dataset

_ROWS = 8000  # a first guess needs no more rows than this, over all records
_FILTERS = 7
# In sample times. The cost has a kink, and may have a minimum on each side of it, wherever a change of the input meets a sample.
_DELAYS = (0.3, 0.7, 1.5, 2.5, 3.5, 4.5, 6.5, 8.5, 12.5, 16.5)
_PASSES = 20
_STARTS = 3
_ENOUGH = (
    0.1  # a pass that moves the output by less than this many standard deviations of the estimate is the last
)
_NEAR = 10.0  # another start is worth its passes if its cost is within this factor of the best one's


class Fraction(Structure, Protocol):
    """The properties of B(s)/A(s) that the guesses need: its orders, and the other terms."""

    @property
    def order(self) -> int:
        """The order n of A."""
        ...

    @property
    def zeros(self) -> int:
        """The order m < n of B."""
        ...

    @property
    def delayed(self) -> bool:
        """Whether there is a delay."""
        ...

    def start_order(self, data: Dataset) -> int:
        """Return the number N of start states."""
        ...


@dataclass(frozen=True, eq=False)
class Trial:
    """A model tried: its joint vector `theta` (P + ΣQ,), and its squared simulation error, `cost`."""

    theta: Array
    cost: float


def best_guesses(structure: Fraction, data: Sequence[Dataset]) -> tuple[Array, ...]:
    """Return the best joint vector found, and a second one where another start ends elsewhere and nearly as well.

    Raises `NotIdentifiable` where the output doesn't move or there are too few samples.
    """
    for record in data:
        _check(record, structure)
    starts = _starts(structure, data)
    if not starts:
        raise NotIdentifiable(
            "no rational model of this order fits these data; try a lower order, or look at them with `servobench "
            "inspect`"
        )
    trials = sorted((refine(structure, data, start) for start in starts), key=lambda trial: trial.cost)
    near = [trial for trial in trials if trials[0].cost * (1 + 1e-6) < trial.cost <= 2 * trials[0].cost]
    return tuple(trial.theta for trial in (trials[0], *near[:1]))


def refine(structure: Fraction, data: Sequence[Dataset], start: Trial) -> Trial:
    """Return the best of the models that refined instrumental variables pass through; the delay goes along by its derivative."""
    best, theta = start, start.theta
    lower, upper = _bounds(structure, data, len(theta))
    for _ in range(_PASSES):
        predictions = _predictions(structure, data, theta)
        cost = _cost(data, predictions)
        if cost <= best.cost:
            best = Trial(theta, cost)
        if not np.isfinite(cost):
            break
        change, moved = _pass(structure, data, theta, predictions)
        theta = np.clip(reflect_poles(structure, theta + change), lower, upper)
        if moved <= _ENOUGH**2 * cost / sum(len(record.y) for record in data):
            break
    final = Trial(theta, _cost(data, _predictions(structure, data, theta)))
    return final if final.cost <= best.cost else best


def regressors(structure: Fraction, theta: Array, data: Dataset, prediction: Prediction) -> Array:
    """Return the Jacobian with the measured output in place of the simulated one, (M, P + Q): what instruments are set against.

    By a_i: -s^(n-i)/A y, for y linear between its samples, without the part at no input and that of the chain's start states.
    """
    shared, n = len(structure.parameters), structure.order
    added = shared + structure.start_order(data)
    y = data.y - prediction.jacobian[:, added:] @ theta[added:]
    out = prediction.jacobian.copy()
    out[:, :n] = -_output_lines(theta[:n], data, y)[:, ::-1]
    return out


def reflect_poles(structure: Fraction, theta: Array) -> Array:
    """Return theta (P + ΣQ,) with the unstable poles of A reflected at the imaginary axis."""
    n = structure.order
    poles = np.roots(np.concatenate([[1.0], theta[:n]]))
    if (poles.real < 0).all() and (theta[:n] > 0).all():
        return theta
    left = -np.abs(poles.real) + 1j * poles.imag
    # A pole on the axis is moved to where it has nearly died out after a few hundred of its own periods.
    left = np.where(-left.real < 1e-3 * np.abs(left), left - 1e-3 * np.abs(left), left)
    out = theta.copy()
    out[:n] = np.real(np.poly(left))[1:]
    return out


def _pass(
    structure: Fraction, data: Sequence[Dataset], theta: Array, predictions: Sequence[Prediction]
) -> tuple[Array, float]:
    """One pass: the change of the joint vector, and by how much it moves the simulated output, squared and summed."""
    from servobench.identification.models.rational import kernels

    shared = len(structure.parameters)
    size = len(theta)
    cross, power, g = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    for record, prediction, place in zip(data, predictions, places(structure, data), strict=True):
        keep = prediction.valid
        z = prediction.jacobian[keep]
        phi = regressors(structure, theta[place], record, prediction)[keep]
        products = np.empty((len(place), 2 * len(place) + 1))
        kernels.products(z, np.column_stack([z, phi, (record.y - prediction.y)[keep]]), products)
        power[np.ix_(place, place)] += products[:, : len(place)]
        cross[np.ix_(place, place)] += products[:, len(place) : -1]
        g[place] += products[:, -1]
    free = np.flatnonzero(np.diag(power) > 0)
    scale = 1.0 / np.sqrt(np.diag(power)[free])
    scaled = cross[np.ix_(free, free)] * np.outer(scale, scale)
    change = np.zeros(size)
    change[free] = scale * np.linalg.lstsq(scaled, scale * g[free], rcond=1e-14)[0]
    if structure.delayed:
        # The output bends with the delay wherever the input jumps: a longer step would lead too far.
        step = 0.5 * max(record.sample_time for record in data)
        change *= min(1.0, step / max(abs(float(change[shared - 1])), 1e-300))
    return change, float(change @ power @ change)


def places(structure: Fraction, data: Sequence[Dataset]) -> list[NDArray[np.int64]]:
    """Return, for each record, where its parameters stand in the joint vector."""
    indices: list[NDArray[np.int64]] = []
    start = len(structure.parameters)
    for record in data:
        own = len(structure.nuisance(record))
        indices.append(np.r_[np.arange(len(structure.parameters)), np.arange(start, start + own)])
        start += own
    return indices


def _bounds(structure: Fraction, data: Sequence[Dataset], size: int) -> tuple[Array, Array]:
    lower, upper = structure.bounds(data)
    free = np.full(size - len(lower), np.inf)
    return np.append(lower, -free), np.append(upper, free)


def _predictions(structure: Fraction, data: Sequence[Dataset], theta: Array) -> list[Prediction]:
    return [
        structure.predict(theta[place], record)
        for record, place in zip(data, places(structure, data), strict=True)
    ]


def _cost(data: Sequence[Dataset], predictions: Sequence[Prediction]) -> float:
    pairs = zip(data, predictions, strict=True)
    cost = sum(float(np.sum((record.y - p.y)[p.valid] ** 2)) for record, p in pairs)
    return cost if np.isfinite(cost) else np.inf


def _check(data: Dataset, structure: Fraction) -> None:
    needed = 2 * (len(structure.parameters) + len(structure.nuisance(data)))
    if len(data.y) < needed:
        raise NotIdentifiable(
            f"{data.name}: {len(data.y)} samples of the output; at least {needed} are needed: record for longer"
        )
    if np.ptp(data.y) == 0:
        raise NotIdentifiable(
            f"{data.name}: the output stays at {data.y[0]:g} {data.output_unit} throughout: nothing moved, or it's "
            "the wrong column; record the motor while it turns"
        )


def _starts(structure: Fraction, data: Sequence[Dataset]) -> list[Trial]:
    """The best few of the regressions with different filters; with a delay also those of other delays, with the best filter."""
    step = max(record.sample_time for record in data)
    longest = max(record.duration for record in data)
    first = _DELAYS[0] * step
    cutoffs = np.geomspace(4.0 / longest, max(1.0 / step, 8.0 / longest), _FILTERS)
    trials = [(cutoff, _regression(structure, data, cutoff, first)) for cutoff in cutoffs]
    trials = sorted((pair for pair in trials if np.isfinite(pair[1].cost)), key=lambda pair: pair[1].cost)
    if structure.delayed and trials:
        cutoff = trials[0][0]
        later = [(cutoff, _regression(structure, data, cutoff, d * step)) for d in _DELAYS[1:]]
        trials = sorted((*trials[:2], *later), key=lambda pair: pair[1].cost)
    return [trial for _, trial in trials[:_STARTS] if trial.cost <= _NEAR * trials[0][1].cost]


def _regression(structure: Fraction, data: Sequence[Dataset], cutoff: float, delay: float) -> Trial:
    """A from the regression with the filter 1/(s + cutoff)^n, the rest from the simulation with that A, at one delay."""
    n, m, shared = structure.order, structure.zeros, len(structure.parameters)
    filter_ = np.asarray(np.poly(np.full(n, -cutoff))[1:], dtype=np.float64)
    thin = max(1, sum(len(record.y) for record in data) // _ROWS)
    blocks = []
    for record in data:
        own, forced = _linear(structure, record, filter_, delay)
        y = _output_lines(filter_, record, record.y)
        highest = record.y - y @ filter_[::-1]
        keep = np.flatnonzero(record.valid)[::thin]
        blocks.append((own[keep], np.hstack([forced, -y[:, ::-1]])[keep], highest[keep]))
    coefficients, _, _ = least_squares(blocks)
    theta = np.zeros(shared)
    theta[:n] = coefficients[m + 1 :]
    if structure.delayed:
        theta[-1] = delay
    if not np.isfinite(theta).all():
        return Trial(theta, np.inf)
    theta = reflect_poles(structure, theta)
    blocks = []
    for record in data:
        own, forced = _linear(structure, record, theta[:n], delay)
        if not np.isfinite(forced).all():
            return Trial(theta, np.inf)
        keep = np.flatnonzero(record.valid)[::thin]
        blocks.append((own[keep], forced[keep], record.y[keep]))
    theta[n : n + m + 1], private, cost = least_squares(blocks)
    return Trial(np.concatenate([theta, *private]), cost * thin)


def _linear(structure: Fraction, data: Dataset, a: Array, delay: float) -> tuple[Array, Array]:
    """The columns in which the simulated output is linear for a given A: the record's own (M, Q), and those of b (M, m + 1)."""
    shared = len(structure.parameters)
    theta = np.zeros(shared + len(structure.nuisance(data)))
    theta[: structure.order] = a
    if structure.delayed:
        theta[shared - 1] = delay
    jacobian = structure.predict(theta, data).jacobian
    return jacobian[:, shared:], jacobian[:, structure.order : structure.order + structure.zeros + 1]


def _output_lines(a: Array, data: Dataset, y: Array) -> Array:
    """s^k/A y (M, n) of the output, from rest at the first sample that is valid."""
    first = int(np.argmax(data.valid))
    out = np.zeros((len(y), len(a)))
    out[first:] = filter_derivatives(a[::-1], linear_pieces(data.t_output[first:], y[first:]))
    return out


def least_squares(blocks: Sequence[tuple[Array, Array, Array]]) -> tuple[Array, list[Array], float]:
    """Return the shared coefficients, each block's own ones, and the cost, of own x + shared b = target over all blocks.

    A block is (M, Q), (M, P) and (M,). Orthogonal triangularisation leaves of each block what its own columns can't explain.
    """
    from servobench.identification.models.rational import kernels

    triangles, scales = [], []
    for own, shared, target in blocks:
        columns = np.vstack([own.T, shared.T, target])
        scale = np.sqrt(np.einsum("kn,kn->k", columns, columns))
        scales.append(np.where(scale > 0, scale, 1.0))
        columns /= scales[-1][:, None]
        triangles.append(np.zeros((len(columns), len(columns))))
        kernels.triangle(columns, triangles[-1])
    owns = [own.shape[1] for own, _, _ in blocks]
    rest = np.vstack([r[q:, q:] * s[q:] for r, s, q in zip(triangles, scales, owns, strict=True)])
    joint = scales[0][owns[0] : -1]
    scaled = np.linalg.lstsq(rest[:, :-1] / joint, rest[:, -1], rcond=1e-13)[0]
    coefficients = np.asarray(scaled / joint, dtype=np.float64)
    cost = float(np.sum((rest[:, -1] - rest[:, :-1] @ coefficients) ** 2))
    private = []
    for r, s, q in zip(triangles, scales, owns, strict=True):
        target = r[:q, -1] * s[-1] - r[:q, q:-1] @ (coefficients * s[q:-1])
        private.append(np.linalg.lstsq(r[:q, :q], target, rcond=1e-13)[0] / s[:q])
    return coefficients, private, cost

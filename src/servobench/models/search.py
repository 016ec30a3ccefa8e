"""A first guess for first-order structures: a search over the time constant and the delay, the rest by least squares.

For a given τ, d and direction of motion, the output is linear in K, K u₀, K u_c and the start state. So a coarse grid over
τ and d, with a linear least-squares problem at each point, finds the region of the global minimum without any step that
could diverge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from servobench.channels import Array
from servobench.errors import NotIdentifiable
from servobench.measurement.dataset import Dataset

if TYPE_CHECKING:
    from servobench.models.first_order import FirstOrder

_ROWS = 4000  # a guess needs no more rows than this, over all records
_TAUS = 24
_DELAYS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # in sample times
_NEAR = 4.0  # a valley is worth a search of its own if its cost is within this factor of the lowest


@dataclass(frozen=True)
class _Trial:
    """One point of the grid: its cost, and the least-squares coefficients."""

    cost: float
    tau: float
    delay: float
    linear: Array


def separable_guesses(structure: FirstOrder, data: Sequence[Dataset]) -> list[Array]:
    """Return vectors of parameters and nuisance parameters of each record, the best first, from a search over τ and d.

    Where the cost has several minima along τ that come near each other, each of them gives a guess (3 at the most).
    Raises `NotIdentifiable` where the output doesn't move or there are too few samples.
    """
    for record in data:
        _check(record, len(structure.parameters))
    senses = [directions(record) for record in data]
    longest = max(record.duration for record in data)
    step = max(record.sample_time for record in data)
    taus = np.geomspace(0.5 * step, max(0.5 * longest, 2 * step), _TAUS)
    trials = [_trial(structure, data, senses, tau, 0.0) for tau in taus]
    found = [_refined(structure, data, senses, trial, step, taus[1] / taus[0]) for trial in _valleys(trials)]
    found.sort(key=lambda trial: trial.cost)
    if not found or not np.isfinite(found[0].cost):
        raise NotIdentifiable(
            "no first-order model comes near these data; look at them with `servobench inspect`"
        )
    return [_vector(structure, data, trial) for trial in found if trial.cost <= _NEAR * found[0].cost]


def _valleys(trials: Sequence[_Trial]) -> list[_Trial]:
    """The local minima of the cost along τ, the three lowest."""
    costs = np.array([np.inf, *(trial.cost for trial in trials), np.inf])
    low = np.flatnonzero((costs[1:-1] <= costs[:-2]) & (costs[1:-1] <= costs[2:]) & np.isfinite(costs[1:-1]))
    return sorted((trials[int(n)] for n in low), key=lambda trial: trial.cost)[:3]


def _refined(
    structure: FirstOrder,
    data: Sequence[Dataset],
    senses: Sequence[Array],
    trial: _Trial,
    step: float,
    ratio: float,
) -> _Trial:
    """The best of a trial and its neighbours in τ and d, `step` the sample time and `ratio` that of the grid of τ."""
    for _ in range(2):
        points = [(trial.tau, factor * step) for factor in _DELAYS]
        points += [(trial.tau * ratio**p, trial.delay) for p in (-0.5, -0.25, 0.25, 0.5)]
        trial = min(
            (trial, *(_trial(structure, data, senses, *point) for point in points)), key=lambda t: t.cost
        )
    return trial


def directions(data: Dataset) -> Array:
    """Return the direction of motion at each output sample, -1, 0 or 1, from the smoothed speed, shape (M,)."""
    speed = smoothed_speed(data)
    scale = float(np.percentile(np.abs(speed), 95))
    return np.where(np.abs(speed) > 0.02 * scale, np.sign(speed), 0.0)


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
        if float(np.percentile(moved, 90)) > 20 * quantum and np.count_nonzero(moved) > 0.5 * len(moved):
            break
        span = min(2 * span, limit)
    index = np.arange(len(y))
    after, before = np.minimum(index + span, len(y) - 1), np.maximum(index - span, 0)
    return (y[after] - y[before]) / (t[after] - t[before])


def _check(data: Dataset, parameters: int) -> None:
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


def _trial(
    structure: FirstOrder, data: Sequence[Dataset], senses: Sequence[Array], tau: float, delay: float
) -> _Trial:
    """Least squares over what is linear, at one τ and d."""
    blocks = [
        _regressors(structure, record, sense, tau, delay) for record, sense in zip(data, senses, strict=True)
    ]
    shared = blocks[0][0].shape[1]
    own = [block[1].shape[1] for block in blocks]
    rows = [len(block[2]) for block in blocks]
    matrix = np.zeros((sum(rows), shared + sum(own)))
    target = np.concatenate([block[2] for block in blocks])
    row, column = 0, shared
    for (common, private, _), n, q in zip(blocks, rows, own, strict=True):
        matrix[row : row + n, :shared] = common
        matrix[row : row + n, column : column + q] = private
        row, column = row + n, column + q
    scale = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    linear = np.linalg.lstsq(matrix / scale, target, rcond=1e-12)[0] / scale
    cost = float(np.sum((target - matrix @ linear) ** 2))
    return _Trial(cost if linear[0] != 0 else np.inf, tau, delay, linear)


def _regressors(
    structure: FirstOrder, data: Dataset, sense: Array, tau: float, delay: float
) -> tuple[Array, Array, Array]:
    """The columns that all records share, those of this record alone, and the target, for some of the rows."""
    from servobench.models.first_order import COULOMB, OFFSET, ONE_WAY, FirstOrder

    unit = FirstOrder((*(p for p in structure.parameters if p not in (COULOMB, OFFSET, ONE_WAY)), OFFSET))
    theta = np.zeros(len(unit.parameters) + len(unit.nuisance(data)))
    names = [parameter.name for parameter in unit.parameters]
    theta[names.index("gain")], theta[names.index("time_constant")], theta[names.index("delay")] = (
        1.0,
        tau,
        delay,
    )
    plain = unit.predict(theta, data)
    shared = [plain.jacobian[:, names.index("gain")]]
    if any(parameter in (OFFSET, ONE_WAY) for parameter in structure.parameters):
        shared.append(plain.jacobian[:, names.index("offset_voltage")])
    if COULOMB in structure.parameters:
        sensed = replace(data, t_input=data.t_output, u=-sense, input_before=-float(sense[0]), delay=-delay)
        shared.append(unit.predict(theta, sensed).jacobian[:, names.index("gain")])
    keep = np.flatnonzero(plain.valid)
    keep = keep[:: max(1, len(keep) // _ROWS)]
    private = plain.jacobian[:, len(names) :]
    return np.column_stack(shared)[keep], private[keep], data.y[keep]


def _vector(structure: FirstOrder, data: Sequence[Dataset], trial: _Trial) -> Array:
    """The whole parameter vector that a trial stands for."""
    from servobench.models.first_order import COULOMB, OFFSET, ONE_WAY

    gain = float(trial.linear[0])
    found = {"gain": gain, "time_constant": trial.tau, "delay": trial.delay}
    column = 1
    for parameter in (OFFSET, ONE_WAY, COULOMB):
        if parameter in structure.parameters:
            value = float(trial.linear[column]) / gain
            found[parameter.name] = float(np.clip(value, parameter.lower, parameter.upper))
            column += 1
    own = trial.linear[column:]
    # A step of the input at the very first sample has no derivative by a delay of exactly zero.
    found["delay"] = max(found["delay"], 0.1 * min(record.sample_time for record in data))
    return np.concatenate([[found[parameter.name] for parameter in structure.parameters], own])

"""The motor's equation as a linear regression, in which a cause for a bad fit is one more column.

    τ ω' + ω = K (u - d u' - u₀ - u_c sgn ω) + what the cause adds

Each signal goes through the same filter F(s) = 1/(T s + 1)³, so that the derivatives of measured signals can be computed (Young
1965). The equation is linear in τ and all other parameters, so it needs no first guess, and bad data in half of a record can't
mislead a search. It isn't meant for estimates, which the noise in ω' biases, but for the improvement that a cause brings.

If the output was measured through a chain L, the equation holds for L ω, so all causes of the motion go through L as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.models.motion import directions, is_one_sine
from servobench.recordings.measurement.dataset import Dataset

_FEWEST, _MOST = 40, 6000  # samples of a record, and points of the grid
_NOISE = 0.02  # of the filtered acceleration may be noise
_SETTLED = 8.0  # filter times until the start is forgotten
_PER_TIME = 4.0  # rows of the regression in a filter time
_JUMP = 0.2  # of the input's range: a change in one step of the grid that is as good as at once
_EVENTS = 1.5  # times through its range: an input that does more than one thing
_OF_ONE_EVENT = 0.3  # of the misfit may be left of a record of one event
_SWEPT = 3.0  # times through its range
_UNSEEN = 0.3  # of the input's standard deviation may pass between two points of the grid


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """One record on an even grid: times t [s], input u, the sense of motion (1, 0 or -1) and the output y, (N,) each.

    `data` is the record as it was measured, y counts from its first value, `step` the time between two points [s],
    `filter_time` is T [s].
    """

    data: Dataset
    t: Array
    u: Array
    sense: Array
    y: Array
    step: float
    filter_time: float

    def filter(self, x: Array, order: int = 0) -> Array:
        """Return F x, or its derivative of that order, for a measured x (N,), at the rows of the regression (R,)."""
        return filter_bilinear(x, self.step, self.filter_time, order)[self.rows]

    def filter_through_chain(self, x: Array, order: int = 0) -> Array:
        """Return F L x, or its derivative of that order, for an x (N,) that acts on the motor, L the measurement chain."""
        return self.filter(self.through_chain(x), order)

    def through_chain(self, x: Array) -> Array:
        """Return L x (N,) for an x (N,) that acts on the motor; a chain that makes a speed of a position gets its integral."""
        chain = self.data.chain.linear
        if not chain:
            return x
        return chain(_integral(x, self.step) if self._from_position else x, self.t)

    @property
    def _from_position(self) -> bool:
        return self.data.shaft_kind == "position" and self.data.kind == "speed"

    @property
    def rows(self) -> NDArray[np.int64]:
        """The points that the regression looks at: those after the filter's start, a quarter of its time apart."""
        return self.rows_behind(self.filter_time)

    def rows_behind(self, time: float) -> NDArray[np.int64]:
        """The same behind a filter of another time [s]."""
        looks_back = int(np.argmax(self.data.chain.linear.valid(self.t)))
        first = looks_back + min(int(np.ceil(_SETTLED * time / self.step)), len(self.t) // 4)
        every = max(1, int(time / _PER_TIME / self.step))
        return np.arange(first, len(self.t), every)

    @property
    def first_speed(self) -> float:
        """The speed that y counts from, which each record has its own of; 0 where y is a position."""
        return float(self.data.y[0]) if self.data.kind == "speed" else 0.0

    @property
    def base(self) -> tuple[Array, Array]:
        """The columns (R, 5) of τ, K, K d, K u_c and K u₀, and the speed (R,) that they make."""
        up = 1 if self.data.kind == "position" else 0
        columns = [
            -self.filter(self.y, 1 + up),
            self.filter_through_chain(self.u),
            -self.filter_through_chain(self.u, 1),
            -self.filter_through_chain(self.sense),
            -self.filter_through_chain(np.ones(len(self.t))),
        ]
        return np.column_stack(columns), self.filter(self.y, up) + self.first_speed


def motion(data: Dataset) -> Motion | None:
    """Return a record on an even grid; None where it is too short to tell anything, or so long that the grid misses its input."""
    span = float(data.t_output[-1] - data.t_output[0]) if len(data.y) > 1 else 0.0
    if len(data.y) < _FEWEST or span <= 0:
        return None
    count = min(round(span / data.sample_time) + 1, _MOST)
    t = np.linspace(float(data.t_output[0]), float(data.t_output[-1]), count)
    y = np.interp(t, data.t_output, data.y)
    y = y - y[0]
    nearest = np.minimum(np.searchsorted(data.t_output, t), len(data.y) - 1)
    step = span / (count - 1)
    if count == _MOST and _grid_error(data, t) > _UNSEEN:
        return None
    grid_motion = Motion(
        data=data,
        t=t,
        # Held for most of the step: a voltage that came a little after its sample acts for all but that little.
        u=input_at(data, t + 0.5 * step),
        sense=directions(data)[nearest],
        y=y,
        step=step,
        filter_time=filter_time(y, step, 2 if data.kind == "position" else 1),
    )
    return grid_motion if len(grid_motion.rows) >= 30 else None


def _grid_error(data: Dataset, t: Array) -> float:
    """The distance of the input's mean between points of the grid from its values there, in its standard deviations."""
    spread = float(np.std(data.u))
    edges = np.concatenate([data.t_input, t])
    order = np.argsort(edges, kind="stable")
    gone = np.concatenate([[0.0], np.cumsum(np.diff(edges[order]) * input_at(data, edges[order][:-1]))])
    along = gone[np.argsort(order, kind="stable")[len(data.t_input) :]]
    ends = 0.5 * (input_at(data, t[:-1]) + input_at(data, t[1:]))
    off = np.diff(along) / np.diff(t) - ends
    return float(np.sqrt(np.mean(off**2))) / spread if spread > 0 else 0.0


def _integral(x: Array, step: float) -> Array:
    """The integral (N,) of an x (N,) that is held from sample to sample, from zero."""
    return np.asarray(step * np.concatenate([[0.0], np.cumsum(x[:-1])]), dtype=np.float64)


def input_at(data: Dataset, t: Array) -> Array:
    """Return the input that holds at times t (N,) [s]; a time that misses a sample by a rounding error is that sample's."""
    held = np.searchsorted(data.t_input, t + 1e-6 * data.sample_time, side="right") - 1
    return np.asarray(np.where(held >= 0, data.u[np.maximum(held, 0)], data.input_before), dtype=np.float64)


def sweep_count(u: Array) -> float:
    """Return how often an input u (N,) goes through its range: the sum of its changes over it, 1 for a step or a ramp."""
    reach = float(np.ptp(u)) if len(u) else 0.0
    return float(np.abs(np.diff(u)).sum()) / reach if reach > 0 else 0.0


def rings(u: Array) -> bool:
    """Return whether an input u (N,) on an even grid would make a shaft ring: a jump, or many changes; a ramp doesn't.

    One sine doesn't show it either: it tells two numbers, and no order of a system.
    """
    reach = float(np.ptp(u)) if len(u) else 0.0
    jumps = reach > 0 and float(np.abs(np.diff(u)).max()) > _JUMP * reach
    return (jumps or sweep_count(u) >= _SWEPT) and not is_one_sine(u)


def may_be_any_shape(motions: Sequence[Motion], left: float) -> bool:
    """Return whether a part of the misfit that is `left` says nothing of further poles: what one step leaves has many shapes.

    So it is where no input does more than one thing, and the poles explain less than most of it.
    """
    return max(sweep_count(each.u) for each in motions) < _EVENTS and left > _OF_ONE_EVENT


def with_extra(
    data: Dataset, extra: Callable[[Array, Array], Array], between: Array | Sequence[float] = ()
) -> Dataset:
    """Return a record with an input that has `extra`(t, u) (N,) more at the times t (N,) of input and output together.

    It is held from one of these times to the next, so that what changes fast needs further times `between` (B,) [s].
    """
    t = np.union1d(np.union1d(data.t_input, data.t_output), between)
    u = input_at(data, t)
    return replace(data, t_input=t, u=u + extra(t, u), reference=None)


def filter_time(y: Array, step: float, order: int, lags: int = 3) -> float:
    """Return the shortest T = 2ⁿ steps [s] at which noise is a small part of the filtered derivative of y (N,) of that order."""
    noise = float(np.std(np.diff(y, 3))) / np.sqrt(20.0)
    random = np.random.default_rng(0).standard_normal(len(y))
    time = 2.0 * step
    while 4 * _SETTLED * time < len(y) * step:
        signal = float(np.std(filter_bilinear(y, step, time, order, lags)))
        if noise * float(np.std(filter_bilinear(random, step, time, order, lags))) <= _NOISE * signal:
            break
        time *= 2.0
    return time


def filter_bilinear(x: Array, step: float, time: float, order: int, lags: int = 3) -> Array:
    """Return s^order/(T s + 1)ⁿ x (N,) by the bilinear rule, from rest; n is the number of lags, `step` and T in seconds."""
    from servobench.recordings.measurement.kernels import first_order_recursion

    c = 2.0 * time / step
    # (T s + 1) with s = 2/h (1 - z⁻¹)/(1 + z⁻¹): ((1 + c) + (1 - c) z⁻¹)/(1 + z⁻¹)
    left = np.full(len(x), (c - 1) / (1 + c))
    out = x
    for n in range(lags):
        earlier = np.append(0.0, out[:-1])
        pushed = 2.0 / step * (out - earlier) if n < order else out + earlier
        out = first_order_recursion(left, (pushed / (1 + c))[:, None])[:, 0]
    return np.asarray(out, dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """Least squares over all records: the coefficients (C,), the sum of squared misfits, the rows, and the total about zero."""

    coefficients: Array
    misfit: float
    rows: int
    total: float


def regression(columns: Array, speed: Array) -> Regression:
    """Return the least-squares solution of columns (R, C) for the speed (R,), in the units of the data."""
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    solution = np.linalg.lstsq(columns / scale, speed, rcond=1e-10)[0]
    rest = speed - columns / scale @ solution
    return Regression(
        coefficients=solution / scale,
        misfit=float(rest @ rest),
        rows=len(speed),
        total=float(speed @ speed),
    )


def join_base(motions: Sequence[Motion]) -> tuple[Array, Array]:
    """The base of all records, one below the other."""
    bases = [each.base for each in motions]
    return np.vstack([columns for columns, _ in bases]), np.concatenate([speed for _, speed in bases])

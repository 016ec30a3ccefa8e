"""The motor's equation as a linear regression, in which a cause for a bad fit is one more column.

    τ ω' + ω = K (u - d u' - u₀ - u_c sgn ω) + what the cause adds

Each signal goes through the same filter F(s) = 1/(T s + 1)³, which makes the derivatives of the measured ones harmless
(Young 1965). It is linear in τ and all the rest, so that no first guess can be wrong, and garbage in half of a record
can't lead a search astray. It isn't meant for estimates: noise in ω' biases them. It is meant to say by how much a cause
makes the equation hold better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array
from servobench.measurement.dataset import Dataset
from servobench.models.search import directions

_MOST = 6000  # points of the grid
_NOISE = 0.02  # of the filtered acceleration may be noise
_SETTLED = 8.0  # filter times until the start is forgotten
_PER_TIME = 4.0  # rows of the regression in a filter time


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """One record on an even grid: times t [s], input u, its unit's largest value, the direction of motion and the position (N,).

    `speed_like` is the measured speed, or None where the position was measured. `filter_time` is T [s].
    """

    data: Dataset
    t: Array
    u: Array
    sense: Array
    y: Array
    step: float
    filter_time: float

    def filtered(self, x: Array, order: int = 0) -> Array:
        """Return F x, or its derivative of that order, for x (N,), at the rows of the regression (R,)."""
        return filtered(x, self.step, self.filter_time, order)[self.rows]

    @property
    def rows(self) -> NDArray[np.int64]:
        """The points that the regression looks at: those after the filter's start, a quarter of its time apart."""
        first = min(int(np.ceil(_SETTLED * self.filter_time / self.step)), len(self.t) // 4)
        every = max(1, int(self.filter_time / _PER_TIME / self.step))
        return np.arange(first, len(self.t), every)

    @property
    def base(self) -> tuple[Array, Array]:
        """The columns (R, 5) of τ, K, K d, K u_c and K u₀, and the speed (R,) that they make."""
        up = 1 if self.data.kind == "position" else 0
        columns = [
            -self.filtered(self.y, 1 + up),
            self.filtered(self.u),
            -self.filtered(self.u, 1),
            -self.filtered(self.sense),
            -self.filtered(np.ones(len(self.t))),
        ]
        return np.column_stack(columns), self.filtered(self.y, up)


def motion(data: Dataset) -> Motion | None:
    """Return a record on an even grid; None where it is too short to tell anything."""
    span = float(data.t_output[-1] - data.t_output[0]) if len(data.y) > 1 else 0.0
    if len(data.y) < 100 or span <= 0:
        return None
    count = min(round(span / data.sample_time) + 1, _MOST)
    t = np.linspace(float(data.t_output[0]), float(data.t_output[-1]), count)
    y = np.interp(t, data.t_output, data.y)
    y = y - y[0]
    nearest = np.minimum(np.searchsorted(data.t_output, t), len(data.y) - 1)
    step = span / (count - 1)
    found = Motion(
        data=data,
        t=t,
        u=input_at(data, t),
        sense=directions(data)[nearest],
        y=y,
        step=step,
        filter_time=_filter_time(y, step, 2 if data.kind == "position" else 1),
    )
    return found if len(found.rows) >= 30 else None


def input_at(data: Dataset, t: Array) -> Array:
    """Return the input that holds at times t (N,); a time that misses a sample by a rounding error is that sample's."""
    held = np.searchsorted(data.t_input, t + 1e-6 * data.sample_time, side="right") - 1
    return np.asarray(np.where(held >= 0, data.u[np.maximum(held, 0)], data.input_before), dtype=np.float64)


def _filter_time(y: Array, step: float, order: int) -> float:
    """The shortest T = 2ⁿ steps for which noise is a small part of the filtered derivative of that order."""
    noise = float(np.std(np.diff(y, 3))) / np.sqrt(20.0)
    random = np.random.default_rng(0).standard_normal(len(y))
    time = 2.0 * step
    while 4 * _SETTLED * time < len(y) * step:
        signal = float(np.std(filtered(y, step, time, order)))
        if noise * float(np.std(filtered(random, step, time, order))) <= _NOISE * signal:
            break
        time *= 2.0
    return time


def filtered(x: Array, step: float, time: float, order: int) -> Array:
    """Return s^order/(T s + 1)³ x by the bilinear rule, from rest."""
    from scipy.signal import lfilter

    c = 2.0 * time / step
    # (T s + 1) with s = 2/h (1 - z⁻¹)/(1 + z⁻¹): ((1 + c) + (1 - c) z⁻¹)/(1 + z⁻¹)
    out = x
    for n in range(3):
        if n < order:
            out = lfilter([2.0 / step, -2.0 / step], [1 + c, 1 - c], out)
        else:
            out = lfilter([1.0, 1.0], [1 + c, 1 - c], out)
    return np.asarray(out, dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Regression:
    """Least squares over all records: the coefficients (C,), the sum of squared misfits, the rows, and the total about zero."""

    coefficients: Array
    misfit: float
    rows: int
    total: float


def regression(columns: Array, speed: Array) -> Regression:
    """Return the least-squares solution of columns (R, C) for the speed (R,)."""
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


def joined(motions: Sequence[Motion]) -> tuple[Array, Array]:
    """The base of all records, one below the other."""
    bases = [each.base for each in motions]
    return np.vstack([columns for columns, _ in bases]), np.concatenate([speed for _, speed in bases])

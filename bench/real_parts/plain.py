"""A plain least-squares fit to hold identification against: what an engineer writes with SciPy in an afternoon.

    τ v' = K (u(t - d) - u_c sgn v) - v

is simulated exactly between changes of the input; gain K, time constant τ, Coulomb voltage u_c and each record's start state
minimise the sum of squares of measured less simulated output, for each delay d of a grid. It shares nothing with the package but
the datasets it is given.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from servobench.recordings.measurement.average import Average
from servobench.recordings.measurement.dataset import Dataset

Array = NDArray[np.float64]
_DELAYS = (
    1,
    2,
    4,
    8,
    16,
    32,
)  # samples; about the best of them the grid is made finer until it is one sample
_TIME_CONSTANTS = 8  # of a geometric grid from a sample to the record's length, to start from
_FRICTIONS = (0.0, 0.1, 0.3)  # of the largest input, to start from
_STARTS = 2  # of them, from which a fit without a delay is begun
_EVALUATIONS = 50  # of a search


@dataclass(frozen=True, kw_only=True)
class Plain:
    """A first-order motor: gain [output unit over input unit], time constant [s], Coulomb voltage [input unit], delay [s]."""

    gain: float
    time_constant: float
    coulomb: float
    delay: float


def fitted(records: Sequence[Dataset]) -> Plain:
    """Return the model that fits records best, by least squares of the simulation error."""
    prepared = [_Prepared(data) for data in records]
    found = {0: min((_search(prepared, begin, 0) for begin in _starts(prepared)), key=_cost)}
    for delay in _DELAYS:
        found[delay] = _search(prepared, min(found.values(), key=_cost).x, delay)
    best = min(found, key=lambda delay: _cost(found[delay]))
    step = best  # the next delay of the grid is twice as long
    while step > 1:
        step //= 2
        for delay in (best - step, best + step):
            found[delay] = _search(prepared, found[best].x, delay)
        best = min(found, key=lambda delay: _cost(found[delay]))
    gain, log_tau, coulomb = found[best].x[:3]
    return Plain(
        gain=gain,
        time_constant=float(np.exp(log_tau)),
        coulomb=coulomb,
        delay=best * prepared[0].data.sample_time,
    )


def residuals(model: Plain, records: Sequence[Dataset]) -> list[tuple[Array, Array]]:
    """Return measured output and what a model leaves of it, of each record, with a start state fitted to it."""
    found = []
    for each in map(_Prepared, records):
        clock = each.clock(model.delay)
        run = least_squares(partial(each.started, clock, model), each.start, x_scale=each.scale)
        found.append((each.data.y[each.valid], run.fun))
    return found


def share(left: Sequence[tuple[Array, Array]]) -> float:
    """Return how much of outputs is explained, 100 (1 - |y - ŷ| / |y - mean(y)|) over all records, each with its own mean [%]."""
    misfit = sum(float(rest @ rest) for _, rest in left)
    return 100.0 * (1.0 - float(np.sqrt(misfit / sum(float(np.sum((y - y.mean()) ** 2)) for y, _ in left))))


@dataclass(frozen=True, eq=False)
class _Clock:
    """The times between which the input holds, those inputs, and which of the times are wanted."""

    steps: Array
    u: Array
    now: NDArray[np.int64]
    before: NDArray[np.int64] | None


class _Prepared:
    """A record, with what a simulation of it needs."""

    def __init__(self, data: Dataset) -> None:
        self.data = data
        self.valid = np.asarray(data.valid)
        self.window = _window(data)
        few = slice(0, min(10, len(data.y)))
        slope = float(np.polyfit(data.t_output[few], data.y[few], 1)[0])
        self.start = np.array([slope, data.y[0]] if data.kind == "position" else [data.y[0]])
        rate = np.ptp(data.y) / (data.duration if data.kind == "position" else 1.0)
        self.scale = np.array([rate, np.ptp(data.y)][: len(self.start)]) + 1e-9

    def clock(self, delay: float) -> _Clock:
        data = self.data
        edges = data.t_input + delay
        wanted = (
            data.t_output if self.window is None else np.union1d(data.t_output, data.t_output - self.window)
        )
        times = np.union1d(wanted, edges[(edges > wanted[0]) & (edges < wanted[-1])])
        held = np.searchsorted(edges, times[:-1], side="right") - 1
        u = np.where(held >= 0, data.u[np.maximum(held, 0)], data.input_before)
        before = None if self.window is None else np.searchsorted(times, data.t_output - self.window)
        return _Clock(np.diff(times), u, np.searchsorted(times, data.t_output), before)

    def started(self, clock: _Clock, model: Plain, start: Array) -> Array:
        return self.residual(clock, model.gain, float(np.log(model.time_constant)), model.coulomb, *start)

    def residual(self, clock: _Clock, gain: float, log_tau: float, coulomb: float, *start: float) -> Array:
        tau = float(np.exp(min(max(log_tau, -12.0), 12.0)))
        v, x = _simulated(clock.steps, clock.u, gain, tau, coulomb, start[0])
        if self.data.kind == "position":
            y = start[1] + x[clock.now]
        elif clock.before is None or self.window is None:
            y = v[clock.now]
        else:
            y = (x[clock.now] - x[clock.before]) / self.window
        return (self.data.y - y)[self.valid]


def _window(data: Dataset) -> float | None:
    """The time [s] over which a speed was averaged; None for a record without a chain."""
    stages = data.chain.linear.stages
    if not stages:
        return None
    if len(stages) == 1 and isinstance(stages[0], Average) and data.kind == "speed":
        return stages[0].window
    raise ValueError(
        f"{data.name}: the plain fit knows no chain but `average` of a speed, not `{data.chain}`"
    )


def _starts(prepared: Sequence[_Prepared]) -> list[Array]:
    """Starting points: a grid of time constants and frictions; the gain is then linear, as friction scales with it."""
    found = []
    longest = max(each.data.duration for each in prepared)
    top = max(float(np.abs(each.data.u).max()) for each in prepared)
    for tau in np.geomspace(prepared[0].data.sample_time, longest, _TIME_CONSTANTS):
        for coulomb in np.array(_FRICTIONS) * top:
            gain, misfit = _gain(prepared, float(np.log(tau)), coulomb)
            own = np.concatenate([each.start for each in prepared])
            found.append((misfit, np.concatenate([[gain, np.log(tau), coulomb], own])))
    found.sort(key=lambda pair: pair[0])
    return [theta for _, theta in found[:_STARTS]]


def _gain(prepared: Sequence[_Prepared], log_tau: float, coulomb: float) -> tuple[float, float]:
    """The best gain for a motor that starts at rest, and the misfit; each record less its mean."""
    above = below = total = 0.0
    for each in prepared:
        still = np.zeros(len(each.start))
        y = each.data.y[each.valid]
        shape = y - each.residual(each.clock(0.0), 1.0, log_tau, coulomb, *still)
        shape, y = shape - shape.mean(), y - y.mean()
        above, below, total = above + shape @ y, below + shape @ shape, total + y @ y
    gain = above / below if below > 0 else 0.0
    return gain, total - gain * above


def _search(prepared: Sequence[_Prepared], begin: Array, delay: int) -> OptimizeResult:
    """The least sum of squares for a delay [samples], from one place."""
    clocks = [each.clock(delay * prepared[0].data.sample_time) for each in prepared]

    def residual(theta: Array) -> Array:
        parts, at = [], 3
        for each, clock in zip(prepared, clocks, strict=True):
            parts.append(each.residual(clock, *theta[:3], *theta[at : at + len(each.start)]))
            at += len(each.start)
        return np.concatenate(parts)

    top = max(float(np.abs(each.data.u).max()) for each in prepared)
    shared = [max(abs(begin[0]), 1e-9), 1.0, max(0.1 * top, 1e-9)]
    scale = np.concatenate([shared, *(each.scale for each in prepared)])
    return least_squares(residual, begin, x_scale=scale, diff_step=1e-6, max_nfev=_EVALUATIONS)


def _cost(run: OptimizeResult) -> float:
    return float(run.cost)


@njit(cache=True)
def _simulated(steps, u, gain, tau, coulomb, v):
    """Speed and way at the end of each step (and at the start), exact while the input holds and the shaft doesn't turn round."""
    speeds, ways = np.empty(len(steps) + 1), np.empty(len(steps) + 1)
    speeds[0], ways[0], x = v, 0.0, 0.0
    for k in range(len(steps)):
        left = steps[k]
        for _ in range(2):
            if v == 0.0 and abs(u[k]) <= coulomb:
                break
            sign = np.sign(v) if v != 0.0 else np.sign(u[k] * gain)
            end = gain * u[k] - abs(gain) * coulomb * sign
            step = left
            if coulomb != 0.0 and v != 0.0 and end * v < 0.0:
                step = min(left, tau * np.log((v - end) / -end))
            decay = np.exp(-step / tau)
            x += end * step + (v - end) * tau * (1.0 - decay)
            v = end + (v - end) * decay
            if step == left:
                break
            v, left = 0.0, left - step
        speeds[k + 1], ways[k + 1] = v, x
    return speeds, ways

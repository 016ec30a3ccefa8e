"""Resistance and torque constant from a measured current, by the winding's equation and the model's own speed.

    i = V/R - (k/R) ω̂ + i₀

is linear in 1/R and k/R. The fitted model simulates ω̂ from the input alone, so it contains no encoder noise and needs no
differentiation: it is its own instrument, and least squares is consistent whatever the noise of the current. The line follows
from R i = V - k ω (docs/decisions/0012-second-order-and-motor-parameters.md). The winding's lag λ is taken into account twice:
samples within 8 lags of a change of the input are left out, and ω̂ is taken λ earlier, the effect of that lag on a slow speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.covariance import conservative, inverse, sandwich_from_bread
from servobench.identification.models.base import simulate_output
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset, keep_with_data
from servobench.recordings.measurement.grid import grid_step

_SETTLED = 8.0  # lags; e^-8 = 0.0003
_LEAST = 30  # samples with a current; fewer say nothing about their own scatter
_TOLERANCE = 1e-9  # of a sample time: two times that differ by less are the same
_EXPLAINED = 0.5  # of the current's variance; an armature's current follows voltage and speed


@dataclass(frozen=True, kw_only=True, eq=False)
class CurrentLine:
    """The coefficients (1/R, k/R, i₀) (3,), their covariance (3, 3) for a given model, and the samples used.

    `explained` is the part of the current's variance that the line explains, 1 where all of it is.
    """

    coefficients: Array
    covariance: Array
    samples: int
    explained: float


def has_current(fit: Fit) -> bool:
    """Return whether any record of the fit has a measured current."""
    return any(record.data.current is not None for record in fit.records)


def current_line(fit: Fit, theta: Array, lag: float) -> CurrentLine | None:
    """Return the line through the measured current for a model's parameters theta (P,) and a lag of the winding [s].

    None where fewer than 30 samples can be used.
    """
    rows = _all_rows(fit, theta, lag)
    x, y = np.vstack([x for x, _ in rows]), np.concatenate([y for _, y in rows])
    step = _quantum(fit)
    if len(y) < _LEAST:
        return None
    bread, beta = _solve(x, y)
    residual = y - x @ beta
    variance = float(residual @ residual) / (len(y) - 3)
    ends = np.cumsum([len(y) for _, y in rows])[:-1]
    scores: Sequence[Array] = np.split(x * residual[:, None], ends)
    spread = float(np.var(y))
    return CurrentLine(
        coefficients=beta,
        covariance=conservative(variance * bread, sandwich_from_bread(bread, scores))
        + _rounding(x, bread, step, variance),
        samples=len(y),
        explained=1.0 - float(np.var(residual)) / spread if spread > 0 else 0.0,
    )


def current_coefficients(fit: Fit, theta: Array, lag: float) -> Array:
    """Return the coefficients (1/R, k/R, i₀) (3,) of `current_line` alone, NaN where there is none."""
    rows = _all_rows(fit, theta, lag)
    x, y = np.vstack([x for x, _ in rows]), np.concatenate([y for _, y in rows])
    return _solve(x, y)[1] if len(y) >= _LEAST else np.full(3, np.nan)


def doubts(line: CurrentLine | None) -> Finding | None:
    """Return why a line through the current can't be used, or None where it can."""
    if line is None:
        return info(
            "current-unused",
            "The measured current isn't used: the input changes again before the winding has settled, or the current has too "
            "few samples; hold each value of the input for some milliseconds, or fit a second-order structure.",
        )
    if line.explained < _EXPLAINED:
        return info(
            "current-not-the-armatures",
            f"The measured current isn't used: voltage and speed explain only {100 * line.explained:.0f} % of it. "
            "It may be the supply's current instead of the armature's, or another motor's.",
        )
    if not (line.coefficients[0] > 0 and line.coefficients[1] > 0):
        return info(
            "current-not-the-armatures",
            "The measured current falls with the voltage, or rises with the speed, so it isn't used: its sign is "
            "inverted, or it isn't this motor's.",
        )
    return None


def _all_rows(fit: Fit, theta: Array, lag: float) -> list[tuple[Array, Array]]:
    """The rows of `_rows` for each record with a current."""
    settled = _SETTLED * max(_whole_delay(fit), lag, 0.0)
    return [
        _rows(fit, record, theta, lag, settled) for record in fit.records if record.data.current is not None
    ]


def _solve(x: Array, y: Array) -> tuple[Array, Array]:
    """(X'X)⁻¹ (3, 3) and the coefficients (3,) of least squares."""
    bread = inverse(x.T @ x)
    return bread, bread @ (x.T @ y)


def _quantum(fit: Fit) -> float:
    """The smallest step of the measured currents [A], 0 where they have none."""
    currents = [record.data.current for record in fit.records if record.data.current is not None]
    return max(grid_step(current[np.isfinite(current)]) or 0.0 for current in currents)


def _rounding(x: Array, bread: Array, step: float, variance: float) -> Array:
    """The part of rounding in the covariance (3, 3) where the current's noise is too small to average it out.

    Below half a step of noise the same current is rounded the same way each time, so that its error, step/√12, is taken as one
    and the same for all samples of one voltage.
    """
    if variance >= (0.5 * step) ** 2:
        return np.zeros_like(bread)
    shift = np.stack([bread @ x[x[:, 0] == level].sum(axis=0) for level in np.unique(x[:, 0])])
    return np.asarray(step**2 / 12.0 * shift.T @ shift, dtype=np.float64)


def _whole_delay(fit: Fit) -> float:
    """The delay of the model, including the winding's lag if the structure has one [s]."""
    names = ("delay", "electrical_time_constant")
    return sum(fit.model[name] for name in names if name in fit.model.names)


def _rows(fit: Fit, record: FittedRecord, theta: Array, lag: float, settled: float) -> tuple[Array, Array]:
    """V, -ω̂ and 1 (N, 3) at the samples that can be used, and the current (N,) there."""
    data = record.data
    if data.current is None:
        return np.empty((0, 3)), np.empty(0)
    since, voltage = _hold_times(data)
    held = since >= settled + data.delay - _TOLERANCE * data.sample_time
    use = np.flatnonzero(held & np.isfinite(data.current) & (data.t_output - lag > data.t_output[0]))
    speed = _speed(fit, record, theta, data.t_output[use] - lag)
    return np.column_stack([voltage[use], -speed, np.ones(len(use))]), data.current[use]


@keep_with_data
def _hold_times(data: Dataset) -> tuple[Array, Array]:
    """The time [s] for which the input has held at each sample of the output (M,), and its value (M,) just before."""
    step = _TOLERANCE * data.sample_time
    before = np.concatenate([[data.input_before], data.u[:-1]])
    changes = data.t_input[data.u != before]
    last = np.searchsorted(changes, data.t_output - step) - 1
    since = np.full(len(data.y), np.inf)
    since[last >= 0] = (data.t_output - changes[np.maximum(last, 0)])[last >= 0] if len(changes) else np.inf
    at = np.searchsorted(data.t_input, data.t_output - step) - 1
    value = np.where(at >= 0, data.u[np.maximum(at, 0)], data.input_before)
    return since, value


def _speed(fit: Fit, record: FittedRecord, theta: Array, t: Array) -> Array:
    """The model's own speed at increasing times (N,) after the first sample, before any chain."""
    structure, data = fit.model.structure, record.data
    names = [parameter.name for parameter in structure.nuisance(data)]
    start = record.nuisance[names.index("start_speed")]
    times = np.concatenate([data.t_output[:1], t])
    shaft = replace(
        data, t_output=times, y=np.zeros(len(times)), output_unit=f"{data.position_unit}/s", kind="speed", quantum=None,
        declared=Chain(), applied=Chain(), current=None, rows=None,
    )  # fmt: skip
    return simulate_output(structure, np.append(theta, start), shaft)[1:]

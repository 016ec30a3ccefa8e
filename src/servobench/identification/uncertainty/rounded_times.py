"""The rounding of the input's times in the intervals, if a record's times are whole microseconds or milliseconds.

A voltage that began to hold a little earlier or later than its time says leaves its mark on the angle for good: over many changes
the angle wanders from that of the model, and the more so the longer the record is. White noise of the output doesn't stand for
that. So times are drawn within what the rounding hides, and carried through the model to the parameters (JCGM 101:2008):

    Δθ = (J'J)⁻¹ J' (y(t + δ) - y(t))

The times of a record that is sampled evenly say nothing of rounding, and are taken as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.least_squares import Layout, information, jacobian_and_residual
from servobench.identification.uncertainty.carried_errors import moves_of, with_line
from servobench.recordings.measurement.dataset import Dataset

DRAWS = 60  # the standard deviation that they give is right to 10 %
_STEPS = tuple(10.0**-power for power in range(1, 8))  # s
_ON_STEP = 1e-3  # of a step: what is so near to a multiple is on it
_MOSTLY = 0.5  # of the times of changes; where a device doesn't tell of each, the others come by the computer's clock
_FEW = 4  # changes of the input
_NEARLY_ALL = 0.95
_FINE = 0.25  # of the median sample time; on a coarser step times say little of when a row was
_SEED = 1
_APART = 1e-9  # s; a voltage that was replaced at once held for less than any motor sees


def with_rounded_times(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for rounded times of the input; the same where that adds nothing.

    A fit that allows for a random torque stays as it is: what the angle wanders by is in that already.
    """
    steps = [time_step(record.data) for record in fit.records]
    if fit.disturbance is not None or not any(steps):
        return fit
    covariance, _ = covariance_of_shifts(fit, steps)
    reason = f"the times at which the input changed are rounded to {max(steps) * 1e6:.4g} µs"
    return with_line(fit, "rounded times", covariance, reason, DRAWS)


def time_step(data: Dataset) -> float:
    """Return the step that the times of a record's changing input are multiples of [s]; 0 where they are even, or on no step."""
    times = data.t_input[1:][np.diff(data.u) != 0.0]
    if len(times) < _FEW:
        return 0.0
    even = float(np.median(np.diff(data.t_input)))
    if _share_on(even, times - times[0]) > _NEARLY_ALL:  # some rows may be missing
        return 0.0
    return next((step for step in _STEPS if step <= _FINE * even and _share_on(step, times) > _MOSTLY), 0.0)


def _share_on(step: float, times: Array) -> float:
    off = np.abs(times / step - np.round(times / step))
    return float(np.mean(off < _ON_STEP))


def covariance_of_shifts(fit: Fit, steps: Sequence[float]) -> tuple[Array, float]:
    """Return the covariance (P, P) of the shared parameters over draws of the true times, and the sum of squares left by a draw.

    `steps` [s] are what the changes of each record's input lie within; 0 where they are where they say.
    """
    layout = Layout(fit.model.structure, tuple(record.data for record in fit.records))
    random, effects, pulls = np.random.default_rng(_SEED), [], np.zeros((DRAWS, len(fit.vector)))
    for record, at, step in zip(fit.records, layout.columns(), steps, strict=True):
        jacobian, moved = _effects(fit, record, step, random)
        effects.append((jacobian, moved, at))
        pulls[:, at] += moved @ jacobian
    moves = moves_of(pulls, information(layout, [jacobian.T @ jacobian for jacobian, _, _ in effects]))
    left = sum(float(np.sum((moved - moves[:, at] @ jacobian.T) ** 2)) for jacobian, moved, at in effects)
    shared = moves[:, : layout.shared]
    return np.asarray(shared.T @ shared / DRAWS), left / DRAWS


def _effects(fit: Fit, record: FittedRecord, step: float, random: np.random.Generator) -> tuple[Array, Array]:
    """The Jacobian (M, P + Q) of a record, and how far its output moves with times as they may have been (draws, M)."""
    structure, data = fit.model.structure, record.data
    theta = np.concatenate([fit.model.theta, record.nuisance])
    usual = structure.predict(theta, data)
    jacobian, _ = jacobian_and_residual(data, usual)
    moved = np.zeros((DRAWS, len(jacobian)))
    if not step:
        return jacobian, moved
    for draw in moved:
        # All may have been rounded up, or all down: that half step is common to them.
        shift = step * (random.uniform(-0.5, 0.5) + random.uniform(-0.5, 0.5, len(data.t_input)))
        t = _in_order(data.t_input + shift)
        draw[:] = (structure.predict(theta, replace(data, t_input=t)).y - usual.y)[usual.valid]
    return jacobian, moved


def _in_order(t: Array) -> Array:
    """Times (N,) [s] of which none is before, or at the same time as, the one before it."""
    least = _APART * np.arange(len(t))
    return np.asarray(np.maximum.accumulate(t - least) + least)

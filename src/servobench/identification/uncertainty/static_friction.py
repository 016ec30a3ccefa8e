"""Static friction larger than sliding friction, seen in the inputs at which a shaft starts and stops: a line of the budget.

A model with one Coulomb friction starts and stops at the same input; fitted to a shaft that doesn't, it puts a friction between
the two and makes up for it with gain and time constant. Under a slowly changing input both levels can be read off without a fit:
while a run from rest to rest lasts, ω = K (u - u_c sgn ω) - K T u' with T the whole lag, which follows from the motor's equation
for ω' = K u'. All that makes a start look late, the lag and the sensor's steps, is taken off its input, and the stop is no lower
than u_c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.core.rounding import TWO_SIDED, with_unit
from servobench.identification.estimators.base import Fit, as_predicted
from servobench.identification.estimators.budget import Contribution
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

SOURCE: Final = "static friction"
_LONG = 10  # samples of rest, and of motion, at least
_PAUSE = 2  # samples without motion that don't end a run
_STEPS = 1.5  # of the sensor, or times the noise: what a shaft at rest may seem to move
_FAR = 16.0  # times that: how far a shaft goes that certainly runs
_SLOWLY = 1.5  # a distance that grows as t³ or faster takes at least 1/1.5 of the time to 16 times itself to begin with
_SUDDEN = 0.1  # of the input: how much it changes while a run starts, at most
_JUMP = (
    0.6  # of the input at the start: a change from one sample to the next before it that is larger is a jump
)
_QUASI_STATIC = 0.95  # of the variance of the speed: what the law of slow motion has to explain
_CLEARLY = 0.15  # of the input at the start: how much lower the stop is, at least
_FEW = 2  # runs


@dataclass(frozen=True, kw_only=True, eq=False)
class Breakaway:
    """The inputs (N,) at the start and at the stop of runs from rest to rest, each positive in the direction of the run."""

    start: Array
    stop: Array


def with_static_friction(fit: Fit) -> Fit:
    """Return the fit with a finding, and a line of its budget that holds both, where the shaft starts at more than it stops at.

    The same where a model has no Coulomb friction of one value, fewer than two slow runs from rest to rest show it, or the model
    itself, whose friction has one value, seems to do so: by when its position gets from one step of the sensor to the next.
    """
    names = fit.model.names
    if "coulomb_voltage" not in names or "stribeck_voltage" in names:
        return fit
    start, stop = _starts_and_stops(fit)
    if not _is_larger(start, stop) or _is_larger(*_starts_and_stops(as_predicted(fit))):
        return fit
    high, low = float(np.median(start)), float(np.median(stop))
    unit = fit.unit("coulomb_voltage")
    sentence = (
        f"The shaft starts at {with_unit(high, unit, 2)} and stops at {with_unit(low, unit, 2)} (medians of {len(start)} runs): "
        "static friction is larger than sliding friction, which a single Coulomb friction can't describe. Identify records in "
        "which the motor keeps turning."
    )
    finding = warning(
        "static-friction", sentence, parameters=("coulomb_voltage", "gain", "time_constant", "delay")
    )
    return _widen(replace(fit, findings=(*fit.findings, finding)), low, high)


def _starts_and_stops(fit: Fit) -> tuple[Array, Array]:
    """The inputs at all starts (N,) and stops (N,) of a fit's records."""
    runs = [each for record in fit.records for each in [breakaway(record.data)] if each is not None]
    return (
        np.concatenate([np.empty(0), *(each.start for each in runs)]),
        np.concatenate([np.empty(0), *(each.stop for each in runs)]),
    )


def _is_larger(start: Array, stop: Array) -> bool:
    """Whether a shaft clearly starts (N,) at more than it stops (N,) at, in most runs."""
    return len(start) >= _FEW and float(np.quantile(1.0 - stop / start, 0.25)) >= _CLEARLY


def _widen(fit: Fit, low: float, high: float) -> Fit:
    at = fit.model.names.index("coulomb_voltage")
    value, variance = float(fit.model.theta[at]), float(fit.covariance[at, at])
    lacking = (max(high - value, value - low) / TWO_SIDED) ** 2 - variance
    if not (np.isfinite(variance) and lacking > 0):
        return fit
    covariance = np.zeros_like(fit.covariance)
    covariance[at, at] = lacking
    reason = "the shaft starts at a larger input than it stops at, and the friction lies between the two"
    return fit.widen(Contribution(source=SOURCE, covariance=covariance, reason=reason))


@keep_with_data
def breakaway(data: Dataset) -> Breakaway | None:
    """Return the inputs at the starts and stops of slow runs from rest to rest; None without a position or such runs.

    The stop is at least the friction that the law of slow motion gives for the runs, as a shaft may also be stopped by an input
    that goes away at once.
    """
    if data.kind != "position" or len(data.y) < 4 * _LONG:
        return None
    step = _STEPS * max(data.quantum or 0.0, data.noise)
    runs = _runs(data.y, step)
    if len(runs) < _FEW:
        return None
    law = _slow_motion(data, runs)
    if law is None:
        return None
    sense, lag, friction = law
    ends = [_ends(data, run, step, sense, lag) for run in runs]
    start_stop_pairs = [(start, max(stop, friction)) for start, stop in ends if start > 0]
    if len(start_stop_pairs) < _FEW:
        return None
    start, stop = np.array(start_stop_pairs).T
    return Breakaway(start=start, stop=stop)


def _runs(y: Array, step: float) -> list[slice]:
    """The samples of each run from rest to rest; motion at an end of the record is none."""
    before, after = np.maximum(np.arange(len(y)) - 1, 0), np.minimum(np.arange(len(y)) + 1, len(y) - 1)
    moving = np.flatnonzero(np.abs(y[after] - y[before]) > step)
    if not len(moving):
        return []
    parts = np.split(moving, np.flatnonzero(np.diff(moving) > _PAUSE + 1) + 1)
    long = [each for each in parts if len(each) >= _LONG and abs(y[each[-1]] - y[each[0]]) > _FAR * step]
    edges = [0, *(int(k) for each in long for k in (each[0], each[-1])), len(y) - 1]
    rests = np.diff(edges)[::2] >= _LONG
    return [
        slice(int(each[0]), int(each[-1]) + 1) for n, each in enumerate(long) if rests[n] and rests[n + 1]
    ]


def _slow_motion(data: Dataset, runs: Sequence[slice]) -> tuple[float, float, float] | None:
    """The sign of the gain, the lag [s] and the largest friction that the law of slow motion gives, if it describes the runs."""
    t, u = data.t_output, data.input_at_output
    rows, speeds = [], []
    for run in runs:
        inner = np.arange(run.start, run.stop)[2:-2]
        wide = max(1, len(inner) // 20)
        at = inner[wide:-wide]
        if not len(at):
            continue
        span = t[at + wide] - t[at - wide]
        speed = (data.y[at + wide] - data.y[at - wide]) / span
        sense = np.sign(data.y[run.stop - 1] - data.y[run.start])
        mean = np.array([u[k - wide : k + wide + 1].mean() for k in at])
        rows.append(
            np.column_stack(
                [mean, np.full(len(at), -sense), -(u[at + wide] - u[at - wide]) / span, np.ones(len(at))]
            )
        )
        speeds.append(speed)
    if not rows:
        return None
    a, v = np.concatenate(rows), np.concatenate(speeds)
    scale = np.abs(a).max(axis=0)
    if len(v) < 4 * _LONG or not (scale > 0).all():
        return None
    x, _, rank, _ = np.linalg.lstsq(a / scale, v, rcond=1e-6)
    left = v - a / scale @ x
    if rank < a.shape[1] or float(left @ left) > (1.0 - _QUASI_STATIC) * float(np.sum((v - v.mean()) ** 2)):
        return None
    gain, lost, late, _ = x / scale
    friction = float(lost / abs(gain)) if gain else np.inf
    return float(np.sign(gain)), max(0.0, float(late / gain)), friction


def _jumps(u: Array, start: float) -> bool:
    """Whether an input (N,) jumps by a good part of its value at the start [input unit], which no slow change does."""
    return float(np.abs(np.diff(u)).max(initial=0.0)) > _JUMP * abs(start)


def _ends(data: Dataset, run: slice, step: float, sense: float, lag: float) -> tuple[float, float]:
    """The input at the start, zero for a sudden one, and at the stop of a run."""
    t, u = data.t_output, data.input_at_output
    way = np.abs(data.y[run] - data.y[run.start])
    turn = sense * np.sign(data.y[run.stop - 1] - data.y[run.start])
    first, surely = (run.start + int(np.argmax(way > far)) for far in (step, _FAR * step))

    def before(sample: int, time: float) -> float:
        return float(turn * u[max(0, int(np.searchsorted(t, t[sample] - time, side="right")) - 1)])

    late = (t[surely] - t[first]) / _SLOWLY + lag
    start, stop = before(first, late), before(run.stop - 1, lag)
    sudden = float(turn * u[surely]) - start > _SUDDEN * start
    # A shaft under a held level may set off long after that began, or seem to where the sensor's steps are large.
    changes = np.flatnonzero(np.diff(u[: first + 1]))
    held_since = int(changes[-1]) if len(changes) else 0
    sudden |= _jumps(u[max(0, min(first - _LONG, held_since)) : surely], start)
    return (0.0 if sudden else start), stop

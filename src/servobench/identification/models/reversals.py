"""What a first-order model can't know about reversals and starts that come within its delay of a change of the input.

What the model calls a delay may be a pure delay, or end in the lag of a fast pole such as the winding's, with a time constant
d up to half a sample time (a longer lag would show in the samples). Both move the motor alike, except while the lag's
transient lasts and friction switches: then friction acts a part of d earlier or later than in the model, and the speed
afterwards differs by that time times the jump of friction's deceleration. The error is at most

    near a reversal: 2 u_c K/τ · d        (friction acts the other way for up to the delay)
    start from rest: |e| K/τ · d ln(1 + |Δu - e| / |e|),   e = |u| - u_c,   Δu the change of the input

and is taken as uniformly distributed between plus and minus that (docs/decisions/0005-first-order-motor.md).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.dataset import Dataset

# Where to look at the speed after a change of the input, in lags; a transient is over after 8 of them: e^-8 = 0.0003.
_LOOKS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 8.0])
_MOST = 100  # more events than this come as a sample of them, scaled
# Each change of the input that is looked at is simulated apart; of more than this, evenly chosen ones stand for all.
_LOOKED_AT = 4000


@dataclass(frozen=True, kw_only=True, eq=False)
class Switching:
    """What there is to know of a motor that sticks: `gain` K, `tau` τ [s], the delay [s], and how it moves.

    `coulomb` is the friction near rest, in the input's unit. `states` gives, for times [s] (K,), the speed and the input at
    which the motor would get no torque.
    """

    gain: float
    tau: float
    coulomb: float
    delay: float
    states: Callable[[Array], tuple[Array, Array]]


def switching_errors(motor: Switching, data: Dataset) -> Array:
    """Return the unresolved errors as columns (M, E) of unit variance, in the output unit of the data."""
    lag = min(motor.delay, 0.5 * data.sample_time)
    when, size = _events(motor, lag, data) if lag > 0 else (np.empty(0), np.empty(0))
    if len(when) > _MOST:
        chosen = np.linspace(0, len(when) - 1, _MOST).astype(int)
        size = size[chosen] * np.sqrt(len(when) / _MOST)
        when = when[chosen]
    if not len(when):
        return np.empty((len(data.y), 0))
    after = np.maximum(data.t_output[:, None] - when[None, :], 0.0)
    decay = np.exp(after / -motor.tau)
    kick = np.where(after > 0, decay, 0.0) if data.shaft_kind == "speed" else motor.tau * (1.0 - decay)
    kick *= size
    return data.chain.linear(kick, data.t_output)


def _events(motor: Switching, lag: float, data: Dataset) -> tuple[Array, Array]:
    """The times of the changes of the input that a stop or a start follows within the transient, and each one's speed error."""
    before = np.concatenate([[data.input_before], data.u[:-1]])
    end = float(data.t_output[-1])
    changes = np.flatnonzero((data.u != before) & (data.t_input >= data.t_output[0]) & (data.t_input < end))
    stride = int(np.ceil(max(len(changes), 1) / _LOOKED_AT))
    changes = changes[::stride]
    t = data.t_input[changes] + motor.delay - lag
    if not len(t):
        return t, t
    looks = np.minimum(t[:, None] + lag * _LOOKS, end)
    points = np.unique(np.append(looks, data.t_output[0]))
    speed, offset = motor.states(points)
    at = np.searchsorted(points, looks)
    seen = speed[at]
    slope = abs(motor.gain) / motor.tau
    # Within the transient the speed itself is known no better than a part of what the change of the input does in a lag.
    blur = 0.4 * slope * np.abs(data.u[changes] - before[changes]) * lag
    starts = (seen[:, 0] == 0) & (seen[:, -1] != 0)
    near = ((seen.min(axis=1) < blur) & (seen.max(axis=1) > -blur)) & (seen != 0).any(axis=1)
    excess = np.maximum(np.abs(data.u[changes] - offset[at[:, 0]]) - motor.coulomb, 1e-12)
    jump = np.maximum(np.abs(data.u[changes] - before[changes]) - excess, 0.0)
    error = np.where(starts, excess * lag * np.log1p(jump / excess), 2 * motor.coulomb * lag) * slope
    chosen = near | starts
    return t[chosen], error[chosen] * np.sqrt(stride / 3.0)

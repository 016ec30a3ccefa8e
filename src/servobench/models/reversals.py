"""What a first-order model can't know about reversals and starts that come within its delay of a change of the input.

What the model calls a delay may be a pure delay, or end in the lag of a fast pole such as the winding's, with a time constant
d up to half a sample time (a longer lag would show in the samples). Both move the motor alike, except while the lag's
transient lasts and friction switches: then friction acts a part of d earlier or later than in the model, and the speed
afterwards differs by that time times the jump of friction's deceleration. The error is at most

    near a reversal: 2 u_c K/τ · d        (friction acts the other way for up to the delay)
    start from rest: |e| K/τ · d ln(1 + |Δu - e| / |e|),   e = |u| - u_c,   Δu the change of the input

and is taken as uniformly distributed between plus and minus that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from servobench.channels import Array
from servobench.measurement.dataset import Dataset

if TYPE_CHECKING:
    from servobench.models.first_order import FirstOrder

# Where to look at the speed after a change of the input, in lags; a transient is over after 8 of them: e^-8 = 0.0003.
_LOOKS = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 8.0])
_MOST = 400  # more events than this come as a sample of them, scaled


def unresolved(structure: FirstOrder, theta: Array, data: Dataset) -> Array:
    """Return the unresolved errors as columns (M, E) of unit variance, in the output unit of the data."""
    from servobench.models import kernels

    p = structure.vector(theta, data)
    lag = min(p[kernels.DELAY], 0.5 * data.sample_time)
    when, size = _events(p, lag, data) if lag > 0 else (np.empty(0), np.empty(0))
    if len(when) > _MOST:
        chosen = np.linspace(0, len(when) - 1, _MOST).astype(int)
        size = size[chosen] * np.sqrt(len(when) / _MOST)
        when = when[chosen]
    after = np.maximum(data.t_output[:, None] - when[None, :], 0.0)
    tau = p[kernels.TAU]
    decay = np.where(after > 0, np.exp(-after / tau), 0.0)
    kick = (
        decay if data.shaft_kind == "speed" else np.where(after > 0, tau * (1.0 - np.exp(-after / tau)), 0.0)
    )
    return data.chain.linear(kick * size, data.t_output) if len(when) else np.empty((len(data.y), 0))


def _events(p: Array, lag: float, data: Dataset) -> tuple[Array, Array]:
    """The times of the changes of the input that a stop or a start follows within the transient, and each one's speed error."""
    from servobench.models import kernels

    gain, tau, offset, coulomb, delay = p[:5]
    before = np.concatenate([[data.input_before], data.u[:-1]])
    end = float(data.t_output[-1])
    changes = np.flatnonzero((data.u != before) & (data.t_input >= data.t_output[0]) & (data.t_input < end))
    t = data.t_input[changes] + delay - lag
    if not len(t):
        return t, t
    looks = np.minimum(t[:, None] + lag * _LOOKS, end)
    points = np.unique(np.append(looks, data.t_output[0]))
    speed, none = np.empty(len(points)), np.empty((len(points), 0))
    columns = np.empty(0, dtype=np.int64)
    kernels.response(data.t_input, data.u, data.input_before, points, p, 1.0, 1.0, columns, speed, none)
    seen = speed[np.searchsorted(points, looks)]
    slope = abs(gain) / tau
    # Within the transient the speed itself is known no better than a part of what the change of the input does in a lag.
    blur = 0.4 * slope * np.abs(data.u[changes] - before[changes]) * lag
    starts = (seen[:, 0] == 0) & (seen[:, -1] != 0)
    near = ((seen.min(axis=1) < blur) & (seen.max(axis=1) > -blur)) & (seen != 0).any(axis=1)
    excess = np.maximum(np.abs(data.u[changes] - offset) - coulomb, 1e-12)
    jump = np.maximum(np.abs(data.u[changes] - before[changes]) - excess, 0.0)
    error = np.where(starts, excess * lag * np.log1p(jump / excess), 2 * coulomb * lag) * slope
    chosen = near | starts
    return t[chosen], error[chosen] / np.sqrt(3.0)

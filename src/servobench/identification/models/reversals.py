"""What a first-order model can't know about reversals and starts that come within its delay of a change of the input.

What the model calls a delay may be a pure delay, or end in the lag of a fast pole such as the winding's, with a time constant
up to half a sample time (a longer lag would show in the samples). Both move the motor alike, except while the lag's transient
lasts and friction switches: then friction acts a part of the lag earlier or later than in the model, and the speed afterwards
differs by that time times the jump of friction's deceleration. One motor has one lag, at all its reversals and starts. So the
error has one size that isn't known, and its course is simulated (docs/decisions/0047-one-lag.md):

    E = (y₂ - y₂ without friction) - (y₁ - y₁ without friction)

y₂ is the output with the longest lag in place of as much of the delay, y₁ that with the delay alone; what the lag does to a
motor without friction isn't counted here. The lag is anything between zero and the longest, so that E is √3 deviations.
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.dataset import Dataset

_LONGEST = 0.5  # of a sample time
_FASTER = 0.45  # of τ: both poles have to lie apart
_NOTHING = 1e-6  # of a sample time


def late_friction(p: Array, data: Dataset) -> Array:
    """Return the unresolved error as a column (M, 1) of unit variance, in the output unit of the data; (M, 0) without a delay.

    p (7,) is (K, τ, u₀, u_c, d, θ and ω at the first sample), as in `models.kernels`, where u_c is friction near rest.
    """
    from servobench.identification.models import kernels

    lag = min(p[kernels.DELAY], _LONGEST * data.sample_time, _FASTER * p[kernels.TAU])
    if not (lag > _NOTHING * data.sample_time and p[kernels.COULOMB] > 0.0):
        return np.empty((len(data.y), 0))
    error = lag_for_delay(p, data, lag, True) - lag_for_delay(p, data, lag, False)
    return np.asarray(error[:, None] / np.sqrt(3.0), dtype=np.float64)


def lag_for_delay(p: Array, data: Dataset, lag: float, friction: bool) -> Array:
    """Return what the output has more (M,) where a `lag` [s] stands in place of as much of the delay, with friction or without.

    p (7,) is as for `late_friction`; the lag is cut where its pole would come too near the motor's.
    """
    from servobench.identification.models import kernels as first
    from servobench.identification.models.second_order import kernels as second

    gain, tau, offset, coulomb, delay, _, speed = (float(value) for value in p)
    lag, acts = min(lag, _FASTER * tau), float(friction)
    held, count = (data.t_input, data.u, data.input_before, data.t_output), len(data.y)
    of_speed = 1.0 if data.shaft_kind == "speed" else 0.0
    none, nowhere = np.empty((count, 0)), np.empty(0, dtype=np.int64)
    one, two = np.empty(count), np.empty(count)
    q = np.array([tau, lag, offset, acts * coulomb, delay - lag, speed / gain])
    second.response(*held, q, acts, of_speed, nowhere, two, none)
    q = np.array([gain, tau, offset, acts * coulomb, delay, 0.0, speed])
    first.motion(*held, q, acts, of_speed, one)
    return data.chain.linear((gain * two - one)[:, None], data.t_output)[:, 0]

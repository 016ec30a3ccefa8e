"""A motor whose delay is in part the lag of a fast pole, such as the winding's.

A pole 1/(1 + ℓ s) spreads a change of the input over exponentially distributed delays of mean ℓ. Ten of them stand for all: the
means of eight parts of 11 % each, in which a stop or a start may fall, and two for the rest, with its moments up to the third
(Gauss-Laguerre quadrature). The result is an input that holds between its changes, so that any structure simulates it as it
does the record's own, through friction, stops and reversals. What friction makes of the lag is right to some 5 %.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.identification.models.base import Structure, simulate_output
from servobench.recordings.measurement.dataset import Dataset

_PARTS, _REST, _NODES_OF_REST = 8, 0.1, 2


def behind_lag(data: Dataset, lag: float) -> Dataset:
    """Return a record whose input comes behind a lag [s] and that much earlier, so that its mean delay is what it was."""
    jumps = np.diff(data.u, prepend=data.input_before)
    at = np.flatnonzero(jumps)
    if not len(at):
        return data
    delays, weights = _delays()
    times, place = np.unique(data.t_input[at, None] + lag * (delays - 1.0), return_inverse=True)
    each = np.bincount(place.ravel(), (jumps[at, None] * weights).ravel(), len(times))
    u = np.asarray(data.input_before + np.cumsum(each), dtype=np.float64)
    return replace(data, t_input=times, u=u, reference=None)


def lag_errors(structure: Structure, theta: Array, data: Dataset, delay: float) -> Array:
    """Return what the output (M, 2) for theta (P + Q,) has more where a share λ of the delay [s] is a lag: λ and λ² times these.

    A second pole changes the output with the square of its time constant; friction that switches in its transient acts earlier or
    later by a part of it. Both come from simulations with the whole of the delay and with half of it for a lag.
    """
    none, half, whole = (
        simulate_output(structure, theta, each)
        for each in (data, behind_lag(data, 0.5 * delay), behind_lag(data, delay))
    )
    if not all(np.isfinite(y).all() for y in (none, half, whole)):
        return np.zeros((len(none), 2))  # beyond what any motor does: nothing is known of the lag
    return np.column_stack([4.0 * half - whole - 3.0 * none, 2.0 * whole + 2.0 * none - 4.0 * half])


def _delays() -> tuple[Array, Array]:
    """Delays in parts of the lag, and how much of a change has each: together all of it, with a mean of 1."""
    each = (1.0 - _REST) / _PARTS
    ends = -np.log(1.0 - each * np.arange(_PARTS + 1))
    later, weights = np.polynomial.laguerre.laggauss(_NODES_OF_REST)
    means = -np.diff((ends + 1.0) * np.exp(-ends)) / each
    return np.append(means, ends[-1] + later), np.append(np.full(_PARTS, each), _REST * weights)

"""The sign of a gain: that of the motion relative to the input, unless the data clearly contradict it.

Friction and inertia take power from the drive, so voltage and speed have the same sign most of the time, or opposite signs if
the wires are crossed. If only one level moved the motor, a gain of the other sign with a friction voltage above that level
gives the same motion, K (u - u_c), and a search may end there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.estimators.least_squares import Minimum, jacobian_and_residual, lowest
from servobench.identification.models.base import Structure
from servobench.identification.models.motion import smooth_speed
from servobench.recordings.measurement.dataset import Dataset

_MOSTLY = 0.8  # of Σ |u ω|: then the motion has the input's sign, or the opposite one
_CLEARLY = 2.0  # times the sum of squares
_LOST = ("coulomb_voltage", "offset_voltage")


def with_usual_sign(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> Minimum:
    """Return the minimum, or one with the usual sign of the gain that is as good.

    So it is by Schwarz's criterion (1978) in effective samples, or where it leaves no more than twice the sum of squares: a small
    drift of the speed speaks for a gain of the other sign, too.
    """
    names = [parameter.name for parameter in structure.parameters]
    sign = usual_sign(data)
    if "gain" not in names or sign == 0 or minimum.theta[names.index("gain")] * sign > 0:
        return minimum
    largest = max(float(np.abs(record.u).max()) for record in data)
    if largest == 0.0:  # a part of a record before which the input was on, and in which it is off
        return minimum
    start = minimum.theta.copy()
    top = max(float(np.abs(smooth_speed(record)).max()) for record in data)
    start[names.index("gain")] = sign * top / largest
    for name in _LOST:
        if name in names:
            start[names.index(name)] = 0.0
    usual = lowest(structure, data, (start,))
    if usual.theta[names.index("gain")] * sign <= 0:
        return minimum
    residuals = [
        jacobian_and_residual(record, prediction)[1]
        for record, prediction in zip(data, usual.predictions, strict=True)
    ]
    worth = sum(effective_samples(residual) for residual in residuals)
    needed = np.log(sum(len(residual) for residual in residuals))
    times = usual.cost / max(minimum.cost, 1e-300)
    return minimum if times > _CLEARLY and worth * np.log(times) > needed else usual


def usual_sign(data: Sequence[Dataset]) -> int:
    """Return 1 or -1 where nearly all motion has the sign of the input or the opposite one, and 0 where neither is so."""
    power = np.concatenate([record.input_at_output * smooth_speed(record) for record in data])
    total = float(np.sum(np.abs(power)))
    share = float(np.sum(power)) / total if total > 0 else 0.0
    return int(np.sign(share)) if abs(share) > _MOSTLY else 0

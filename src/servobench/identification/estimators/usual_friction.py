"""Gain and friction where one level of the input moved the motor: a friction that motors have.

One level u tells K (u - u_c) alone, a hyperbola of gains and frictions: they can't be identified apart (Bellman and Åström
1970). A search ends anywhere on it: at a friction of 90 % of the level and ten times the gain, or at a friction that drives. Far
out, what is linear in K and u_c leaves the hyperbola, and the speed at the level, which the data do tell, got an interval 10
times too wide. So a friction below zero or above half of the level is set to that limit, unless the data say otherwise by more
than chance would.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.estimators.least_squares import Minimum, jacobian_and_residual, lowest
from servobench.identification.models.base import Structure
from servobench.identification.models.level import one_level
from servobench.recordings.measurement.dataset import Dataset

_LARGEST = 0.5  # of the level: motors that lose more of it to friction hardly turn
_NOTHING = 1e-300  # a sum of squares that has a logarithm
_BY_CHANCE = 9.0  # in twice the log-likelihood: three standard deviations


def with_usual_friction(
    structure: Structure, data: Sequence[Dataset], minimum: Minimum, held: Sequence[int] = ()
) -> Minimum:
    """Return the minimum, or one with a usual friction, as good within chance, where one level of the input moved the motor.

    A constant that is larger than the input, so that the gain has the wrong sign, gives way however well it fits.

    The entries of the joint vector with the numbers `held` stay as they are.
    """
    at = one_level(structure, data)
    if at is None or at.level == 0.0:
        return minimum
    gain, lost, driven = at.gain, at.friction, at.level
    share = minimum.theta[lost] / driven
    usual = float(np.clip(share, 0.0, _LARGEST))
    if share == usual or share == 1.0:
        return minimum
    start = minimum.theta.copy()
    start[gain] *= (1.0 - share) / (1.0 - usual)
    start[lost] = usual * driven
    free = ~np.isin(np.arange(len(start)), (lost, *held))
    likely = lowest(structure, data, (start,), free)
    if share > 1.0:
        return likely  # without an input it would turn faster, and the other way round of what its gain says
    worth = sum(
        effective_samples(jacobian_and_residual(record, prediction)[1])
        for record, prediction in zip(data, minimum.predictions, strict=True)
    )
    rise = np.log(max(likely.cost, _NOTHING) / max(minimum.cost, _NOTHING))
    return likely if worth * rise <= _BY_CHANCE else minimum

"""The minimum on the other side of an input under which the shaft rests, where Coulomb friction comes near to it.

A loop often holds its motor at rest with a small constant input. Friction of less than that lets the model's shaft creep, which
costs much; friction of more costs nothing there, however large. So the sum of squares has a corner at that input: a search that
comes from below stays on it, and the slope below says nothing of how far friction may be above (friction at rest takes any value
up to its limit: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.identification.estimators.delay_across import lower_of, standard_deviation
from servobench.identification.estimators.least_squares import Minimum, lowest
from servobench.identification.models.base import Structure
from servobench.identification.models.motion import stands
from servobench.recordings.measurement.dataset import Dataset

FRICTION = "coulomb_voltage"  # the parameter
_REACH = 3.0  # standard deviations
_BEYOND = 1.5  # times the input: where the search begins anew
_HELD = 3  # samples


def with_friction_across(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> Minimum:
    """Return the minimum, or the lower one with more friction than an input that it is near to; the other stands beside it."""
    names = [parameter.name for parameter in structure.parameters]
    if not structure.friction or FRICTION not in names:
        return minimum
    at = names.index(FRICTION)
    corner = nearest_corner(data, float(minimum.theta[at]))
    if corner is None or not abs(minimum.theta[at] - corner) <= _REACH * standard_deviation(
        structure, data, minimum, at
    ):
        return minimum
    start = minimum.theta.copy()
    start[at] = _BEYOND * corner
    return lower_of(minimum, lowest(structure, data, (start,)), data)


def nearest_corner(data: Sequence[Dataset], friction: float) -> float | None:
    """Return the size of the input under which the shaft rests for some samples that is nearest to a friction [input unit]."""
    sizes = np.concatenate([np.abs(record.input_at_output[stands(record)]) for record in data])
    levels, counts = np.unique(sizes[sizes > 0], return_counts=True)
    levels = levels[counts >= _HELD]
    return float(levels[np.argmin(np.abs(levels - friction))]) if len(levels) else None

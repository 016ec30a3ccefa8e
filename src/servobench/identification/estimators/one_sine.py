"""The minima beside the one where a search ends, if one sine drives a motor with friction.

A sine tells amplitude and phase, and what else is known of gain, time constant, friction and delay lies in the corners that
friction makes at each reversal. They fall between the samples: along the valley of these four the sum of squares has a minimum
for each way in which samples and reversals can meet, none of which the curvature of another knows of. A search begins anew from
time constants a little off, each of which leads to one of the next minima (several starts: Rinnooy Kan and Timmer 1987); what is
nearly as good is weighed by `other_minima`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from servobench.identification.estimators.least_squares import Minimum, lowest
from servobench.identification.models.base import Structure
from servobench.identification.models.motion import is_one_sine
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

_BESIDE = (0.8, 0.9, 1.1, 1.25)  # times the time constant


def with_neighbours(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> Minimum:
    """Return the minimum, or the lowest of its neighbours, where one sine drives a motor with friction; the others beside it."""
    names = [parameter.name for parameter in structure.parameters]
    if not (structure.friction and "time_constant" in names and are_driven_by_one_sine(data)):
        return minimum
    ends = [minimum]
    for factor in _BESIDE:
        start = minimum.theta.copy()
        start[names.index("time_constant")] *= factor
        ends.append(lowest(structure, data, [start]))
    best = min(ends, key=lambda end: end.cost)
    return replace(
        best, others=(*minimum.others, *((end.theta, end.cost) for end in ends if end is not best))
    )


def are_driven_by_one_sine(data: Sequence[Dataset]) -> bool:
    """Return whether the input of each record is one sine; this is found once, however many structures are fitted."""
    return all(map(_is_driven_by_one_sine, data))


@keep_with_data
def _is_driven_by_one_sine(data: Dataset) -> bool:
    return is_one_sine(data.u)

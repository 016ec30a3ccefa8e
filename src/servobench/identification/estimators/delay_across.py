"""The minimum on the other side of the sampling instant that a delay may lie beyond.

Between two samples the response to a step of the input is a smooth function of the delay. Where the step acts at a sample, it
has a corner: one sample more or less answers to the step. So the sum of squares may have a minimum on either side, and a search
stays on the side on which it comes in. Where the delay's interval reaches the corner, the other side is searched, too (several
starts: Rinnooy Kan and Timmer 1987); what is nearly as good is weighed by `other_minima`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.identification.estimators.covariance import inverse
from servobench.identification.estimators.least_squares import (
    Layout,
    Minimum,
    information,
    lowest,
    square_jacobians,
)
from servobench.identification.models.base import Structure
from servobench.recordings.measurement.dataset import Dataset

_REACH = 3.0  # standard deviations
_WORTH = 0.01  # in twice the log-likelihood


def with_delay_across(structure: Structure, data: Sequence[Dataset], minimum: Minimum) -> Minimum:
    """Return the minimum, or the lower one with a delay across the nearest sampling instant; the other stands beside it."""
    names = [parameter.name for parameter in structure.parameters]
    if "delay" not in names:
        return minimum
    at, step = names.index("delay"), max(record.sample_time for record in data)
    delay = float(minimum.theta[at])
    corner = step * round(delay / step)
    if corner <= 0:
        return minimum
    sd = standard_deviation(structure, data, minimum, at)
    if not abs(delay - corner) <= _REACH * sd < _REACH * step:
        return minimum
    start = minimum.theta.copy()
    start[at] = corner + (0.5 * step if delay < corner else -0.5 * step)
    return lower_of(minimum, lowest(structure, data, (start,)), data)


def lower_of(minimum: Minimum, other: Minimum, data: Sequence[Dataset]) -> Minimum:
    """Return the lower of two minima, with the other beside it; the first where the difference is the search's own."""
    samples = sum(len(record.y) for record in data)
    gained = samples * np.log(max(minimum.cost, 1e-300) / max(other.cost, 1e-300))
    low, high = (other, minimum) if gained > _WORTH else (minimum, other)
    return replace(low, others=(*minimum.others, *other.others, (high.theta, high.cost)))


def standard_deviation(structure: Structure, data: Sequence[Dataset], minimum: Minimum, at: int) -> float:
    """Return the standard deviation of parameter number `at`, for white noise; infinite where the data say nothing about it."""
    layout = Layout(structure, tuple(data))
    h = information(layout, square_jacobians(layout, minimum.predictions))
    freedom = sum(len(record.y) for record in data) - len(minimum.theta)
    variance = float(inverse(h)[at, at]) * minimum.cost / max(freedom, 1)
    return float(np.sqrt(variance)) if variance > 0 else np.inf

"""The rounding of a speed that no number of samples averages out: one reading for as long as it lasts, or all towards zero.

A whole number of steps may be the nearest one, or what a division of whole numbers leaves: half a step less on the average, of
either sign, which looks like friction.
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.models.steady import stretches_of_input
from servobench.identification.uncertainty.carried_errors import covariance_of_errors, with_line
from servobench.recordings.measurement.dataset import Dataset

_ROUNDED = 12**-0.5  # standard deviation of a value that lies anywhere within a step
# Of a step: the mean of what may be cut off lies anywhere from none to half a step on either side.
_CUT = 0.5 * 3**-0.5
_FINE = 1e-3  # of the range: half of a step that is finer shifts nothing that matters
_ALIKE = 0.9  # of the samples in the second half of a stretch
_FEWEST = 8  # samples of a stretch


def with_rounding_that_stays(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for the steps of a speed; the same where they are fine, or of a position."""
    errors = [_errors(record.data) for record in fit.records]
    if not any(errors):
        return fit
    reason = "a settled speed may read one value all the time, and what is cut off of steps is friction to the model"
    return with_line(fit, "rounding that stays", covariance_of_errors(fit, errors), reason, np.inf)


def _errors(data: Dataset) -> list[Array]:
    """An error (M,) for each stretch of a constant input in which the speed settles at one reading, and one for all readings."""
    if data.kind != "speed":
        return []
    step = float(np.diff(np.unique(data.y)).min(initial=np.inf))
    if not _FINE * float(np.ptp(data.y)) < step < np.inf:
        return []
    errors = [_CUT * step * np.sign(data.y)]
    for first, end in zip(*stretches_of_input(data), strict=True):
        settled = data.y[(first + end) // 2 : end]
        if end - first < _FEWEST or np.mean(settled == np.median(settled)) < _ALIKE:
            continue
        if np.median(settled) != 0.0:  # a shaft that stands reads nothing, whatever the step
            error = np.zeros(len(data.y))
            error[first:end] = _ROUNDED * step
            errors.append(error)
    return errors

"""What the input does between rows that are as far apart as the motor is slow, or farther.

A log of every tenth row, or one beside a controller with a clock of its own, shows a change of the input at the next row, up to a
row late. What is common to all changes looks like a delay; the rest shifts a position by the speed times the time, for good. Such
times are drawn within a row and carried to the parameters as those of `rounded_times` are. Where a controller has the rows' own
clock nothing of this is there, and the residual says so: what the draws leave of the output is at most what the fit leaves.
"""

from __future__ import annotations

import numpy as np

from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.models.common_parameters import TIME_CONSTANT
from servobench.identification.uncertainty.carried_errors import with_line
from servobench.identification.uncertainty.rounded_times import DRAWS, covariance_of_shifts

_FEW = 2  # changes of the input: one alone is a delay


def with_changes_between_rows(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for changes of the input between rows; the same where that adds nothing.

    A fit that allows for a random torque stays as it is: what the angle wanders by is in that already.
    """
    steps = [_row(fit, record) for record in fit.records]
    if fit.disturbance is not None or not any(steps):
        return fit
    covariance, expected = covariance_of_shifts(fit, steps)
    left = sum(float(np.sum(record.residual[record.valid] ** 2)) for record in fit.records)
    if not expected > 0.0:
        return fit
    reason = f"each change of the input may lie anywhere between two rows, {1e3 * max(steps):.3g} ms apart"
    return with_line(fit, "changes between rows", covariance * min(left / expected, 1.0), reason, DRAWS)


def _row(fit: Fit, record: FittedRecord) -> float:
    """The time between two rows of the input [s]; 0 where the motor is slower, or the input hardly changes."""
    if TIME_CONSTANT.name not in fit.model.names or np.count_nonzero(np.diff(record.data.u)) < _FEW:
        return 0.0
    row = record.data.input_step
    return row if fit.model[TIME_CONSTANT.name] < row else 0.0

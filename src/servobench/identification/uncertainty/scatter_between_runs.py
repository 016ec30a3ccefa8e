"""The scatter between runs, where each record has one level of the input and the gain is a difference between runs.

Nothing in such records shows by how much a motor's speed differs from one run to the next, of a battery, a brush or a bearing.
The settled speeds of nineteen runs of one real motor under nineteen levels lie within 0.24 % (one standard deviation) of a
straight line. Beside levels far apart that is nothing; between 95 and 100 % it is a tenth of the gain and more.
"""

from __future__ import annotations

import numpy as np

from servobench.identification.estimators.base import Fit
from servobench.identification.models.level import has_one_level_each
from servobench.identification.uncertainty.carried_errors import covariance_of_errors, with_line

_SCATTER = 0.004  # of the motion: more than that of the one motor, whose battery was fresh
_FREEDOM = 5.0  # of motors as different as people own, from one that was measured


def with_scatter_between_runs(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for the scatter between runs; the same where a record has several levels."""
    if not has_one_level_each([record.data for record in fit.records]):
        return fit
    motions = []
    for record in fit.records:
        start = record.prediction[record.valid][0] if record.data.kind == "position" else 0.0
        motions.append([_SCATTER * np.asarray(record.prediction - start)])
    reason = f"each record has one level, and a motor's speed differs by {100 * _SCATTER:g} % from run to run"
    return with_line(fit, "scatter between runs", covariance_of_errors(fit, motions), reason, _FREEDOM)

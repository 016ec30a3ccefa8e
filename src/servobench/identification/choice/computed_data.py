"""Simulated records: those that a linear model explains to the computer's last digit.

New users often begin with a simulation of their own. The residual of such a record is the rounding of the arithmetic. It
contains neither friction nor a random torque, and experience with real motors doesn't apply to it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, info
from servobench.identification.choice.structure_ladder.comparison import fit_structure
from servobench.identification.estimators.base import Estimator, Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset

# Of the output's variation: a thousand times what arithmetic with 53 bits leaves after 10⁴ steps, and a thousandth of the finest
# encoder's step in a run of one turn.
_ROUNDING = 1e-9
_MANY = 3  # changes of the output for each parameter: as many values as parameters are explained to any digit


def fit_to_computed(method: Estimator, data: Sequence[Dataset], fit: Fit) -> Fit | None:
    """Return the fit without friction of data that it explains to the last digit; None for data with any noise.

    `fit` is a fit of a structure that has first_order in it: where it leaves more than rounding, so does that.
    """
    if not _is_rounding(fit) or sum(_changes(record) for record in data) < _MANY * len(fit.vector):
        return None
    try:
        linear = fit_structure(method, STRUCTURES["first_order"], data)
    except NotIdentifiable:
        return None
    if not _is_rounding(linear):
        return None
    sizes = {
        "offset_voltage": max(float(np.abs(record.u).max()) for record in data),
        "delay": linear.model["time_constant"],
    }
    spread = np.array([_ROUNDING * sizes.get(name, abs(linear.model[name])) for name in linear.model.names])
    reason = "the arithmetic that computed the output keeps only so many digits"
    return linear.widen(Contribution(source="arithmetic", covariance=np.diag(spread**2), reason=reason))


def _changes(record: Dataset) -> int:
    """The samples in which the output is another one than in the sample before: a rest is explained by anything."""
    return int(np.count_nonzero(np.diff(record.y)))


def about_computed() -> Finding:
    """Return what there is to say of such data."""
    return info(
        "output-computed",
        "The model explains the output to the last digit that a computer keeps, so these values were computed, not measured. The "
        "intervals cover rounding in the arithmetic only, not what a real motor does.",
    )


def _is_rounding(fit: Fit) -> bool:
    """Whether a fit leaves nothing but the rounding of the arithmetic, which that of a sensor's own steps isn't."""
    spread = max(float(np.ptp(record.data.y)) for record in fit.records)
    steps = max(record.data.quantum or 0.0 for record in fit.records)
    return max(fit.residual_sd, steps) <= _ROUNDING * spread

"""Friction that is larger near rest than at speed (Stribeck 1902), which a constant friction leaves out: a line of the budget.

Only the moments around stops and reversals show whether a motor has it, and what it does there moves gain, time constant and
friction. It falls to nothing within some part of the largest speed, from a few hundredths to a quarter, and is at most half of
the Coulomb friction. What it does to the output is exact (`models.near_rest`), how large it is as of any term that a motor may
have (`possible_term`), but that a large excess is more probable than a small one: what lubrication makes of friction near rest
are tenths of it (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994). Where a random torque stands for something that depends on
the motion (`systematic_torque`), the data are no judge of its course.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol, runtime_checkable

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.models.base import Structure
from servobench.identification.uncertainty.possible_term import possible_covariance, size_before
from servobench.identification.uncertainty.score_test import ScoreTest, in_innovations
from servobench.identification.uncertainty.systematic_torque import Moving, systematic_share
from servobench.recordings.measurement.dataset import Dataset

SOURCE: Final = "friction near rest"
_WIDTHS = (0.03, 0.06, 0.12, 0.25)  # of the largest speed: where the excess has fallen to nothing
_NONE = 0.7  # the chance that a motor has no excess
_POWER = 1.0  # of the size: its density, if there is any
_LARGEST = 0.5  # of the Coulomb friction: the largest excess at rest
BEFORE: Final = size_before(_NONE, _POWER) * _LARGEST
"""The root mean square of the excess before any data, as a part of the Coulomb friction."""


@runtime_checkable
class ExcessFriction(Moving, Protocol):
    """A structure that knows what more friction near rest would do."""

    def by_excess_friction(self, theta: Array, data: Dataset, width: float) -> Array:
        """Return the derivative of the prediction (M,) by a volt more at rest, which falls to nothing at the speed `width`."""
        ...


def with_friction_near_rest(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for friction that may be larger near rest than the model's.

    The same where the model has no friction, or more than one, or nothing is left over.
    """
    added = excess_covariance(fit)
    if not added.any():
        return fit
    reason = "friction near rest may be up to half as large again as at speed"
    return fit.widen(Contribution(source=SOURCE, covariance=added, reason=reason))


def excess_covariance(fit: Fit) -> Array:
    """Return the covariance (P, P) that not knowing the friction near rest adds to that of the parameters."""
    shared = len(fit.model.theta)
    none = np.zeros((shared, shared))
    if not np.isfinite(fit.residual_sd) or fit.residual_sd == 0:
        return none
    vectors = [np.concatenate([fit.model.theta, record.nuisance]) for record in fit.records]
    errors = excess_errors(fit.model.structure, vectors, [record.data for record in fit.records])
    if not errors:
        return none
    both = zip(fit.records, errors, strict=True)
    columns = np.concatenate([in_innovations(fit, record, each) for record, each in both])
    forms = _LARGEST * columns.T
    return possible_covariance(
        ScoreTest(fit, 1.0), *forms, none=_NONE, power=_POWER, doubt=systematic_share(fit)
    )


def excess_errors(structure: Structure, vectors: Sequence[Array], data: Sequence[Dataset]) -> list[Array]:
    """Return what each record's output would have more if friction were twice as large at rest, (M, W), for its vector (P + Q,).

    A column for each width within which the excess falls to nothing. An empty list for a structure without a
    Coulomb friction of that kind, and for motors at rest.
    """
    names = [parameter.name for parameter in structure.parameters]
    if not (structure.friction and isinstance(structure, ExcessFriction) and "coulomb_voltage" in names):
        return []
    coulomb = float(vectors[0][names.index("coulomb_voltage")])
    both = list(zip(vectors, data, strict=True))
    top = max(float(np.abs(structure.speed(theta, record)).max()) for theta, record in both)
    if not (coulomb > 0 and top > 0):
        return []
    return [
        coulomb
        * np.column_stack([structure.by_excess_friction(theta, record, width * top) for width in _WIDTHS])
        for theta, record in both
    ]

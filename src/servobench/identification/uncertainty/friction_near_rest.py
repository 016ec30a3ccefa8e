"""Friction that is larger near rest than at speed (Stribeck 1902), which a constant friction leaves out: a line of the budget.

Only the moments around stops and reversals show whether a motor has it, and what it does there moves gain and friction. The
excess has one size s for all records, as a part of the Coulomb friction, and falls to nothing within a tenth of the largest
speed. Before the data it is zero with a chance of three quarters, else anything up to a half, all sizes being alike probable.
It moves the parameters by s B c, c the exact derivative of the output (`models.near_rest`) and B = (J'J)⁻¹ J', so that the
covariance has more

    B c c' B' E[s²]

by the mixture that the residuals leave of the two (model averaging: Hoeting, Madigan, Raftery and Volinsky 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol, runtime_checkable

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.covariance import andrews_lag, long_run
from servobench.identification.models.base import Structure
from servobench.identification.uncertainty.score_test import ScoreTest, in_innovations
from servobench.recordings.measurement.dataset import Dataset

SOURCE: Final = "friction near rest"
_NARROW = 0.1  # of the largest speed: where the excess has fallen to nothing
_LARGEST = 0.5  # of the Coulomb friction: the largest excess at rest
_NONE = 0.75  # the chance that there is none
_SIZES = np.linspace(0.0, _LARGEST, 101)
BEFORE: Final = float(np.sqrt((1.0 - _NONE) * np.mean(_SIZES**2)))
"""The root mean square of the excess before any data, as a part of the Coulomb friction."""
_NOTHING = 1e-20  # of a column's power: what is left of one that the Jacobian explains is rounding error


@runtime_checkable
class ExcessFriction(Protocol):
    """A structure that knows what more friction near rest would do."""

    def by_excess_friction(self, theta: Array, data: Dataset, width: float) -> Array:
        """Return the derivative of the prediction (M,) by a volt more at rest, which falls to nothing at the speed `width`."""
        ...

    def speed(self, theta: Array, data: Dataset) -> Array:
        """Return the shaft's speed (M,) at the samples."""
        ...


def with_friction_near_rest(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for friction that may be larger near rest than the model's.

    The same where the model has no friction, or more than one, or nothing is left over.
    """
    added = excess_covariance(fit)
    if not added.any():
        return fit
    reason = "friction near rest may be larger than at speed by up to half of itself"
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
    column = np.concatenate([in_innovations(fit, record, each[:, None]) for record, each in both])[:, 0]
    test = ScoreTest(fit, 1.0)
    rest = column - test.basis @ (test.basis.T @ column)
    if not float(rest @ rest) > _NOTHING * float(column @ column):
        return none
    off = test.joint_shift(column)[:shared]
    return np.asarray(_mean_square(rest, test.innovations) * np.outer(off, off), dtype=np.float64)


def excess_errors(structure: Structure, vectors: Sequence[Array], data: Sequence[Dataset]) -> list[Array]:
    """Return what each record's output (M,) would have more if friction were twice as large at rest, for its vector (P + Q,).

    Nothing for a structure without a Coulomb friction of that kind, and for motors at rest.
    """
    names = [parameter.name for parameter in structure.parameters]
    if not (structure.friction and isinstance(structure, ExcessFriction) and "coulomb_voltage" in names):
        return []
    coulomb = float(vectors[0][names.index("coulomb_voltage")])
    both = list(zip(vectors, data, strict=True))
    top = max(float(np.abs(structure.speed(theta, record)).max()) for theta, record in both)
    if not (coulomb > 0 and top > 0):
        return []
    return [coulomb * structure.by_excess_friction(theta, record, _NARROW * top) for theta, record in both]


def _mean_square(rest: Array, innovations: Array) -> float:
    """E[s²] by what the innovations (N,) say of a column (N,); where they are coloured, that is less."""
    power = float(rest @ rest)
    score = (rest * innovations)[:, None]
    colour = max(1.0, float(long_run(score, andrews_lag(score))[0, 0]) / power)
    log_likelihood = (float(score.sum()) * _SIZES - 0.5 * power * _SIZES**2) / colour
    highest = float(log_likelihood.max())
    likely = np.exp(log_likelihood - highest)
    some = (1.0 - _NONE) / len(_SIZES)
    whole = _NONE * np.exp(-highest) + some * float(likely.sum())
    return float(some * (likely @ _SIZES**2) / whole)

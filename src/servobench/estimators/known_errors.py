"""What errors that a structure knows of, but can't resolve, add to the covariance: as much as the residuals leave of them.

A prediction may be wrong by E a, with E the columns of `Structure.unmodelled` and a of unit variance (M, E). They move the
parameters by B a, B = H⁻¹ J'E, and leave E⊥ a in the residuals, E⊥ = E - J B. So the residuals tell about them (Bayes' rule for
a normal a, Bishop 2006, equations 3.53 and 3.54; each sample has a weight w and a score s):

    V = (I + E⊥' w E⊥)⁻¹,   m = V E⊥' s,   covariance added: B (V + m m') B'

Where the data speak of a pure delay, m and V are small, and so is what is added; where they speak of a lag, m is not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array
from servobench.measurement.dataset import Dataset
from servobench.models.base import Structure


@dataclass(frozen=True, kw_only=True, eq=False)
class Weighed:
    """A record at the minimum: its part `theta` (P + Q,) of the joint vector and where that stands there, `place` (P + Q,).

    `jacobian` (V, P + Q) and, for each sample used, `weight` (V,) and `score` (V,): 1/σ² and r/σ² for white noise. `used` (M,)
    says which samples those are.
    """

    data: Dataset
    """The record."""
    theta: Array
    place: NDArray[np.int64]
    jacobian: Array
    weight: Array
    score: Array
    used: NDArray[np.bool_]


def of_known_errors(structure: Structure, records: Sequence[Weighed], bread: Array) -> Array:
    """Return the covariance (P, P) to be added for what the structure can't resolve; `bread` (P, P) is the inverse of Σ J'wJ."""
    columns = [_of_samples(structure.unmodelled(each.theta, each.data), each.used) for each in records]
    count = sum(errors.shape[1] for errors in columns)
    if not count:
        return np.zeros_like(bread)
    shift, at = np.zeros((len(bread), count)), 0
    for each, errors in zip(records, columns, strict=True):
        own = slice(at, at + errors.shape[1])
        shift[each.place, own] = (each.jacobian * each.weight[:, None]).T @ errors
        at = own.stop
    moved, at = bread @ shift, 0
    told, said = np.eye(shift.shape[1]), np.zeros(shift.shape[1])
    for each, errors in zip(records, columns, strict=True):
        left = -each.jacobian @ moved[each.place]
        left[:, at : at + errors.shape[1]] += errors
        at += errors.shape[1]
        told += (left * each.weight[:, None]).T @ left
        said += left.T @ each.score
    mean = moved @ np.linalg.solve(told, said)
    return np.asarray(moved @ np.linalg.solve(told, moved.T) + np.outer(mean, mean), dtype=np.float64)


def _of_samples(errors: Array, used: NDArray[np.bool_]) -> Array:
    """The rows of errors (M, E) that are used, without a copy where all are."""
    return errors if used.all() else errors[used]

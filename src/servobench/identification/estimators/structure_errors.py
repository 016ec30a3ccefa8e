"""Known but unresolved errors of a structure: what they add to the covariance, given the residuals.

A prediction may be wrong by E a, with E the columns of `Structure.unmodelled` and a of unit variance (M, E). They move the
parameters by B a, B = H⁻¹ J'E, and leave E⊥ a in the residuals, E⊥ = E - J B. So the residuals contain information about them
(Bayes' rule for a normal a, Bishop 2006, equations 3.53 and 3.54; each sample has a weight w and a score s):

    V = (I + E⊥' w E⊥)⁻¹,   m = V E⊥' s,   covariance added: B (V + m m') B'

If the data speak against such errors, m and V are small, and little is added; if they speak for them, m is large.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.models.base import Structure
from servobench.recordings.measurement.dataset import Dataset


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightedRecord:
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


def of_known_errors(structure: Structure, records: Sequence[WeightedRecord], bread: Array) -> Array:
    """Return the covariance (P, P) to be added for what the structure can't resolve; `bread` (P, P) is the inverse of Σ J'wJ."""
    columns = [_of_samples(structure.unmodelled(each.theta, each.data), each.used) for each in records]
    count = sum(errors.shape[1] for errors in columns)
    if not count:
        return np.zeros_like(bread)
    ends = np.cumsum([errors.shape[1] for errors in columns])
    each_own = [slice(end - errors.shape[1], end) for end, errors in zip(ends, columns, strict=True)]
    shift = np.zeros((len(bread), count))
    for each, errors, own in zip(records, columns, each_own, strict=True):
        shift[each.place, own] = (each.jacobian * each.weight[:, None]).T @ errors
    moved = bread @ shift
    # E⊥'wE⊥ is multiplied out: E⊥ itself has a column in each record for the errors of all the others.
    information, score = np.eye(count), np.zeros(count)
    for each, errors, own in zip(records, columns, each_own, strict=True):
        part, weighed = moved[each.place], each.weight[:, None]
        information += part.T @ ((each.jacobian * weighed).T @ each.jacobian) @ part
        crossed = shift[each.place, own].T @ part
        information[own] -= crossed
        information[:, own] -= crossed.T
        information[own, own] += (errors * weighed).T @ errors
        score -= part.T @ (each.jacobian.T @ each.score)
        score[own] += errors.T @ each.score
    mean = moved @ np.linalg.solve(information, score)
    return np.asarray(moved @ np.linalg.solve(information, moved.T) + np.outer(mean, mean), dtype=np.float64)


def _of_samples(errors: Array, used: NDArray[np.bool_]) -> Array:
    """The rows of errors (M, E) that are used, without a copy where all are."""
    return errors if used.all() else errors[used]

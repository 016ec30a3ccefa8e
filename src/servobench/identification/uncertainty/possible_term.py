"""The additional covariance for a term of unknown size that a motor may have and its model lacks.

Its size s is one for all records. Before the data it is zero with a chance of three quarters, else anything up to a largest one,
all sizes being alike probable. It moves the parameters by s B c, c the derivative of the innovations by s and B = (J'J)⁻¹ J', so
that the covariance has more

    B c c' B' E[s²]

by the mixture that the residuals leave of the two (model averaging: Hoeting, Madigan, Raftery and Volinsky 1999).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.covariance import andrews_lag, long_run
from servobench.identification.uncertainty.score_test import ScoreTest

_NONE = 0.75  # the chance that there is none
_SIZES = np.linspace(0.0, 1.0, 101)  # of the largest
BEFORE: Final = float(np.sqrt((1.0 - _NONE) * np.mean(_SIZES**2)))
"""The root mean square of the size before any data, as a part of the largest."""
_NOTHING = 1e-20  # of a column's power: what is left of one that the Jacobian explains is rounding error


def possible_covariance(test: ScoreTest, column: Array) -> Array:
    """Return the covariance (P, P) that a term adds which has `column` (N,) in the innovations where it is largest."""
    shared = len(test.fit.model.theta)
    rest = column - test.basis @ (test.basis.T @ column)
    if not float(rest @ rest) > _NOTHING * float(column @ column):
        return np.zeros((shared, shared))
    off = test.joint_shift(column)[:shared]
    return np.asarray(_mean_square(rest, test.innovations) * np.outer(off, off), dtype=np.float64)


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

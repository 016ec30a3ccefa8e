"""The additional covariance for a term of unknown size that a motor may have and its model lacks.

Its size s is one for all records. Before the data it is zero with some chance, three quarters for most terms, else anything up
to a largest one, for most terms all sizes being alike probable. It moves the parameters by s B c, c the derivative of the
innovations by s and B = (J'J)⁻¹ J', so that the covariance has more

    B c c' B' E[s²]

by the mixture that the residuals leave of the two (model averaging: Hoeting, Madigan, Raftery and Volinsky 1999). Where nobody
knows the term's form, each of several is as probable as another before the data.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.covariance import andrews_lag, long_run
from servobench.identification.uncertainty.score_test import ScoreTest

USUALLY_NONE: Final = 0.75
"""The chance, before any data, that a motor doesn't have a term."""
_SIZES = np.linspace(0.0, 1.0, 101)  # of the largest
_FAR = 6.0  # standard deviations of a size beyond the likeliest: none is larger
_NOTHING = 1e-20  # of a column's power: what is left of one that the Jacobian explains is rounding error


def size_before(none: float, power: float = 0.0) -> float:
    """Return the root mean square of the size before any data, as a part of the largest.

    `none` is the chance of no such term; if there is one, the density of its sizes is as s^`power`.
    """
    return float(np.sqrt((1.0 - none) * (power + 1.0) / (power + 3.0)))


def possible_covariance(
    test: ScoreTest, *forms: Array, none: float = USUALLY_NONE, power: float = 0.0, doubt: float = 0.0
) -> Array:
    """Return the covariance (P, P) added by a term; its possible `forms` (N,) are what the innovations have of the largest.

    `none` is the chance, before the data, that there is no such term; if there is one, the density of its sizes is as s^`power`.
    With `doubt` (0 to 1) the innovations are no judge of it, and there is such a term: 1 leaves all sizes as before the data.
    """
    shared = len(test.fit.model.theta)
    rests = [(column, column - test.basis @ (test.basis.T @ column)) for column in forms]
    visible_forms = [(c, rest) for c, rest in rests if float(rest @ rest) > _NOTHING * float(c @ c)]
    added = np.zeros((shared, shared))
    if not visible_forms:
        return added
    none *= 1.0 - doubt
    each = [_sizes(rest, test.innovations, doubt) for _, rest in visible_forms]
    sizes, logarithms = np.array([one[0] for one in each]), np.array([one[1] for one in each])
    highest = float(logarithms.max())
    before = (power + 1.0) * sizes**power * sizes[:, -1:] / _SIZES.size
    likely = (1.0 - none) / len(visible_forms) * before * np.exp(logarithms - highest)
    likely /= none * np.exp(-highest) + float(likely.sum())
    for (column, _), size, odds in zip(visible_forms, sizes, likely, strict=True):
        off = test.joint_shift(column)[:shared]
        added += float(odds @ size**2) * np.outer(off, off)
    return added


def _sizes(rest: Array, innovations: Array, doubt: float) -> tuple[Array, Array]:
    """Sizes of a column (N,), as far as there is any chance of one, and what the innovations (N,) say of each, over none of it.

    Where they are coloured, they say less.
    """
    power = float(rest @ rest)
    score = (rest * innovations)[:, None]
    colour = max(1.0, float(long_run(score, andrews_lag(score))[0, 0]) / power)
    total, weight = float(score.sum()), (1.0 - doubt) / colour
    spread = 1.0 / np.sqrt(power * weight) if weight > 0 else np.inf
    sizes = min(1.0, max(total / power, 0.0) + _FAR * spread) * _SIZES
    return sizes, np.asarray(weight * (total * sizes - 0.5 * power * sizes**2), dtype=np.float64)

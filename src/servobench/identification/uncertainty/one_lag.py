"""A motor has one lag: what not knowing how much of the delay is the lag of a fast pole adds to the covariance.

What a first-order model calls a delay may be a pure delay, or a share λ of it the lag of a fast pole, such as the winding's.
Then the output has λ p + λ² q more (`models.lag`), and the parameters are off by B (λ p + λ² q), B = (J'J)⁻¹ J'. λ is the
same in all records and at each reversal. Before the data all values from 0 to 1 are alike probable, after them in proportion
to the likelihood; the covariance added is the mean square of that error (model averaging: Hoeting, Madigan, Raftery and
Volinsky 1999). It vanishes where the data show a pure delay.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.covariance import andrews_lag, long_run
from servobench.identification.models.lag import lag_errors
from servobench.identification.uncertainty.score_test import ScoreTest, in_innovations

SOURCE: Final = "second pole not modelled"
_SHARES = np.linspace(0.0, 1.0, 201)
_NOTHING = 1e-20  # of a column's power: what is left of one that the Jacobian explains is rounding error


def with_one_lag(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for what not knowing what the delay is made of adds."""
    added = lag_covariance(fit)
    if not added.any():
        return fit
    reason = "part of the delay may be the lag of the winding or of a compliant shaft"
    return fit.widen(Contribution(source=SOURCE, covariance=added, reason=reason))


def lag_covariance(fit: Fit) -> Array:
    """Return the covariance (P, P) that not knowing what the delay is made of adds to that of the parameters.

    It is zero without a delay, and where nothing is left over to ask.
    """
    shared = len(fit.model.theta)
    none = np.zeros((shared, shared))
    delay = fit.model["delay"] if "delay" in fit.model.names else 0.0
    if delay <= 0 or not np.isfinite(fit.residual_sd) or fit.residual_sd == 0:
        return none
    test = ScoreTest(fit, 1.0)
    columns = np.concatenate(
        [
            in_innovations(
                fit, run.record, lag_errors(fit.model.structure, run.theta, run.record.data, delay)
            )
            for run in test.runs
        ]
    )
    if not np.isfinite(columns).all():  # with a lag the model runs away
        return none
    rest = columns - test.basis @ (test.basis.T @ columns)
    if not (np.sum(rest**2, axis=0) > _NOTHING * np.sum(columns**2, axis=0)).any():
        return none
    powers = np.array([_SHARES, _SHARES**2])
    off = np.column_stack([test.joint_shift(column)[:shared] for column in columns.T])
    moments = powers * _likelihood(rest, test.innovations, powers) @ powers.T
    return np.asarray(off @ moments @ off.T, dtype=np.float64)


def _likelihood(rest: Array, innovations: Array, powers: Array) -> Array:
    """The probability of each share (S,), from the innovations (N,) and columns (N, 2), each with its `powers` (2, S).

    Where the innovations are coloured, they say as much less as the variance of the score for the whole lag is larger.
    """
    whole = rest.sum(axis=1)
    power = float(whole @ whole)
    score = (whole * innovations)[:, None]
    colour = max(1.0, float(long_run(score, andrews_lag(score))[0, 0]) / power) if power > 0 else 1.0
    log_likelihood = innovations @ rest @ powers - 0.5 * np.einsum(
        "is,ij,js->s", powers, rest.T @ rest, powers
    )
    weights = np.exp((log_likelihood - log_likelihood.max()) / colour)
    return np.asarray(weights / weights.sum(), dtype=np.float64)

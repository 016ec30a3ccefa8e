"""The form in which friction falls with the speed, which a Stribeck term supposes: a line of the budget.

    f(ω) = u_c + u_s e^(-|ω|/ω_s)   in the model,   f(ω) = u_c + u_s e^(-(ω/c ω_s)²)   at the other end, c = 2/√π

In the literature the exponent lies between a half and two and beyond, and nothing but a slow motion through rest shows it
(Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, section 2.1). The area below the two curves is the same, so that only the
form differs. Each mixture of the two is as probable as another before the data; these say what they can (`possible_term`).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.uncertainty.possible_term import possible_covariance
from servobench.identification.uncertainty.score_test import SMALL, Motion, ScoreTest, Term

SOURCE: Final = "how friction falls"
OTHER_FALL: Final = "friction-falls-otherwise"
"""The code of the term for another form of the fall."""
_SAME_AREA = 2.0 / math.sqrt(math.pi)


def with_fall_of_friction(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for another form of the fall; the same for a model without a Stribeck term."""
    if "stribeck_voltage" not in fit.model.names or fit.model["gain"] == 0:
        return fit
    largest = max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records)
    if not (largest > 0 and np.isfinite(fit.residual_sd) and fit.residual_sd > 0):
        return fit
    test, term = ScoreTest(fit, largest), other_fall(fit, largest)
    column = np.concatenate([run.columns([term])[0][:, 0] for run in test.runs]) / SMALL
    added = possible_covariance(test, column, none=0.0) if np.isfinite(column).all() else np.zeros(0)
    if not added.any():
        return fit
    reason = "friction may fall with the square of the speed at first, not in proportion to it"
    return fit.widen(Contribution(source=SOURCE, covariance=added, reason=reason))


def other_fall(fit: Fit, largest: float) -> Term:
    """Return the term for the other form, for a fit with a Stribeck term: what it takes of the `largest` input [input unit]."""
    share = float(np.sign(fit.model["gain"])) * fit.model["stribeck_voltage"] / largest

    def more(motion: Motion) -> tuple[Array, ...]:
        speed = np.abs(motion.speed) * motion.fastest / fit.model["stribeck_speed"]
        differs = np.exp(-((speed / _SAME_AREA) ** 2)) - np.exp(-speed)
        return (-share * np.sign(motion.speed) * differs,)

    return Term(
        code=OTHER_FALL,
        name="friction that falls in another form",
        sentence="Friction falls with the speed in another form than the model's exponential.",
        to_input=more,
    )

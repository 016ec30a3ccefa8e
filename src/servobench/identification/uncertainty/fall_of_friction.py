"""The form in which friction falls with the speed, which a Stribeck term supposes: a line of the budget.

    f(ω) = u_c + u_s e^(-x) in the model,   f(ω) = u_c + u_s e^(-(x/c)²) or u_c + u_s / (1 + (x/d)²) elsewhere,   x = |ω|/ω_s

In the literature the fall is an exponential, a Gaussian (the usual one), or a fraction that goes on to large speeds, and nothing
but a slow motion through rest shows which (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, section 2.1). The area below the
curves is the same, c = 2/√π and d = 2/π, so that only the form differs. Each mixture of the model's with one of the others is as
probable as another before the data; these say what they can (`possible_term`).
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
_GAUSSIAN, _FRACTION = 2.0 / math.sqrt(math.pi), 2.0 / math.pi  # widths of the same area


def with_fall_of_friction(fit: Fit) -> Fit:
    """Return the fit with the line of its budget for another form of the fall; the same for a model without a Stribeck term."""
    if "stribeck_voltage" not in fit.model.names or fit.model["gain"] == 0:
        return fit
    largest = max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records)
    if not (largest > 0 and np.isfinite(fit.residual_sd) and fit.residual_sd > 0):
        return fit
    test, term = ScoreTest(fit, largest), other_fall(fit, largest)
    forms = np.concatenate([run.columns([term])[0] for run in test.runs]) / SMALL
    added = possible_covariance(test, *forms.T, none=0.0) if np.isfinite(forms).all() else np.zeros(0)
    if not added.any():
        return fit
    reason = "friction may fall later and faster than the model's, or go on falling for longer"
    return fit.widen(Contribution(source=SOURCE, covariance=added, reason=reason))


def other_fall(fit: Fit, largest: float) -> Term:
    """Return the term for the other forms, for a fit with a Stribeck term: what they take of the `largest` input [input unit]."""
    share = float(np.sign(fit.model["gain"])) * fit.model["stribeck_voltage"] / largest

    def more(motion: Motion) -> tuple[Array, ...]:
        x = np.abs(motion.speed) * motion.fastest / fit.model["stribeck_speed"]
        others = np.exp(-((x / _GAUSSIAN) ** 2)), 1.0 / (1.0 + (x / _FRACTION) ** 2)
        return tuple(-share * np.sign(motion.speed) * (other - np.exp(-x)) for other in others)

    return Term(
        code=OTHER_FALL,
        name="friction that falls in another form",
        sentence="Friction doesn't fall exponentially with the speed, as the model assumes.",
        to_input=more,
    )

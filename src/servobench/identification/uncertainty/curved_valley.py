"""A valley of the cost that isn't straight: how far the parameters go along it where a time constant isn't known by itself.

A single sine tells an amplitude and a phase, and so two of gain, time constant and delay. Far above its corner only K/τ shows,
and the curvature there says that K/τ is known well whatever τ is. Nearer to the corner it is not: at ω τ = 1 the same amplitude
needs a K/τ that is larger by √2, and the phase a longer delay. So τ is held at shorter values, and the others are searched for.
Of places that explain the data as well but for chance (a likelihood ratio that 5 % of runs exceed: Wilks 1938) the farthest makes
the line,

    C = δ δ' / 1.96²,   δ_i = θ_i ln(θ_i'/θ_i) for gain and time constant, θ_i' - θ_i for the others,

with logarithms, as products and quotients of the two are what is known of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.estimators.least_squares import NormalEquations, lowest
from servobench.identification.uncertainty.identifiability import State, parameter_statuses

SOURCE: Final = "valley not straight"
_CHANCE = 3.84  # the likelihood ratio that chance exceeds in 5 % of runs, with one parameter
_STEP = 0.6  # from one held time constant to the next


def with_curved_valley(fit: Fit) -> Fit:
    """Return the fit with a line of its budget where shorter time constants explain the data as well; else the same."""
    if not _is_open(fit):
        return fit
    far = max(
        _ways(fit), key=lambda way: float(np.abs(way[fit.model.names.index("time_constant")])), default=None
    )
    if far is None:
        return fit
    reason = "shorter time constants explain the data equally well, with other values of the rest"
    return fit.widen(Contribution(source=SOURCE, covariance=np.outer(far, far) / TWO_SIDED**2, reason=reason))


def _is_open(fit: Fit) -> bool:
    """Whether a simulation's time constant is known in a combination with the gain only."""
    if fit.estimator != "output_error" or not isinstance(fit.model.structure, NormalEquations):
        return False
    if not {"gain", "time_constant"} <= set(fit.model.names):
        return False
    answers = parameter_statuses(fit, ("gain", "time_constant"))
    return all(each.state is State.COMBINATION for each in answers.values())


def _ways(fit: Fit) -> Iterator[Array]:
    """The ways (P,) to places of shorter time constants that explain the data as well but for chance."""
    at = fit.model.names.index("time_constant")
    structure, data = fit.model.structure, [record.data for record in fit.records]
    samples = sum(effective_samples(record.residual[record.valid]) for record in fit.records)
    cost = sum(float(np.sum(record.residual[record.valid] ** 2)) for record in fit.records)
    start = fit.vector
    free = np.arange(len(start)) != at
    shortest = max(float(structure.bounds(data)[0][at]), 0.5 * min(record.sample_time for record in data))
    tau = min(float(start[at]), max(record.duration for record in data))
    while (tau := _STEP * tau) > shortest:
        held = start.copy()
        held[at] = tau
        held[fit.model.names.index("gain")] *= tau / start[at]
        minimum = lowest(structure, data, (held,), free)
        if not minimum.cost > 0 or samples * np.log(minimum.cost / cost) > _CHANCE:
            return
        start = minimum.theta
        yield _way(fit, minimum.theta[: len(fit.model.theta)])


def _way(fit: Fit, there: Array) -> Array:
    """From where a fit is to another place, of gain and time constant by their logarithms."""
    here = fit.model.theta
    way: Array = there - here
    for name in ("gain", "time_constant"):
        at = fit.model.names.index(name)
        if there[at] * here[at] > 0:
            way[at] = here[at] * np.log(there[at] / here[at])
    return way

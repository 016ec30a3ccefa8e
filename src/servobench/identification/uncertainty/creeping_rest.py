"""A rest through which the model creeps by less than a count: what that seems to tell of friction and offset is rounding.

Before a step from rest an encoder shows one count for as long as one likes. An offset that is a little larger than Coulomb
friction lets the model's shaft creep there, and so makes up for how far that count lies from where the motion begins: one
rounding, which the sum of squares has once for each sample of the rest. The search ends just beyond that corner, where the rest
has slopes by offset and friction, and the covariance takes both for known. Where the shaft stands (friction at rest takes any
value up to its limit: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994) it has none. So what counts is the covariance with just
so much friction that the model's shaft stands: steps of one level in either direction tell two speeds, of gain, friction and
offset.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.budget import Contribution, beyond
from servobench.identification.estimators.friction_across import FRICTION
from servobench.identification.estimators.sizes import sizes
from servobench.identification.models.first_motion import rests_at_first
from servobench.identification.models.records import START_SPEED
from servobench.identification.uncertainty.score_test import innovations_and_jacobian
from servobench.identification.uncertainty.weak_priors import root_of_covariance

SOURCE: Final = "a rest that tells nothing"
_OFFSET = "offset_voltage"
_FEW = 3  # samples of a rest that shows
_ABOVE = 1.0 + 1e-6  # times what holds the shaft


def with_creeping_rest(fit: Fit) -> Fit:
    """Return the fit with a line of its budget where the model creeps through a rest in which no count changes; else the same."""
    names = set(fit.model.names)
    if not fit.model.structure.friction or not {FRICTION, _OFFSET, "time_constant"} <= names:
        return fit
    needed = max((_needed(fit, record) for record in fit.records if _stands(record)), default=0.0)
    if not needed > fit.model[FRICTION] or not fit.residual_sd > 0:
        return fit
    jacobian, e = innovations_and_jacobian(fit)
    variance = float(e @ e) / max(len(e) - jacobian.shape[1], 1)
    standing, _ = innovations_and_jacobian(_at_rest(fit, _ABOVE * needed))
    reason = (
        "the model creeps through a rest in which no count changes, by less than a count, and that says nothing of friction "
        "and offset"
    )
    added = beyond(_covariance(fit, standing, variance), _covariance(fit, jacobian, variance))
    return fit.widen(Contribution(source=SOURCE, covariance=added, reason=reason))


def _needed(fit: Fit, record: FittedRecord) -> float:
    """The Coulomb friction [input unit] that holds the shaft in the rest of a record, beside what else holds or pulls it."""
    value = dict(zip(fit.model.names, map(float, fit.model.theta), strict=True))
    angle = float(record.prediction[0])
    sine, cosine = value.get("gravity_voltage_sine", 0.0), value.get("gravity_voltage_cosine", 0.0)
    gravity = sine * np.sin(angle) + cosine * np.cos(angle)
    held = value.get("stribeck_voltage", 0.0) + value.get("load_friction", 0.0) * abs(gravity)
    return float(abs(record.data.u[0] - value[_OFFSET] - gravity) - held)


def _at_rest(fit: Fit, friction: float) -> Fit:
    """The same model with so much Coulomb friction [input unit] that it stands in each rest."""
    theta = fit.model.theta.copy()
    theta[fit.model.names.index(FRICTION)] = friction
    records = tuple(
        replace(record, nuisance=_without_speed(fit, record)) if _stands(record) else record
        for record in fit.records
    )
    return replace(fit, model=replace(fit.model, theta=theta), records=records)


def _without_speed(fit: Fit, record: FittedRecord) -> Array:
    names = [parameter.name for parameter in fit.model.structure.nuisance(record.data)]
    return np.where(np.array(names) == START_SPEED.name, 0.0, record.nuisance)


def _covariance(fit: Fit, jacobian: Array, variance: float) -> Array:
    """The covariance (P, P) by rows of the Jacobian (N, P + ΣQ) and what is possible at all."""
    scale, shared = sizes(fit)[: jacobian.shape[1]], len(fit.model.names)
    root = root_of_covariance(fit, jacobian, scale, variance) * scale[:, None]
    return np.asarray(variance * (root @ root.T)[:shared, :shared], dtype=np.float64)


def _stands(record: FittedRecord) -> bool:
    """Whether the count of an encoder stays the same from the beginning of a record until the input sets the shaft off."""
    data, motion = record.data, record.data.first_motion
    if not data.quantum or data.kind != "position" or motion is None or not rests_at_first(data):
        return False
    rest = data.t_output <= motion.cause
    return bool(np.count_nonzero(rest) > _FEW and (data.y[rest] == data.y[0]).all())

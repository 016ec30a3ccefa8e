"""A rest through which the model creeps by a count or so: what that seems to tell of friction and offset is rounding.

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
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.budget import Contribution, beyond
from servobench.identification.estimators.friction_across import FRICTION
from servobench.identification.models.first_motion import rests_at_first
from servobench.identification.models.records import START_SPEED
from servobench.identification.uncertainty.score_test import innovations_and_jacobian
from servobench.identification.uncertainty.weak_priors import covariance_with_priors
from servobench.recordings.measurement.dataset import Dataset, keep_with_data
from servobench.recordings.measurement.grid import grid_step

SOURCE: Final = "a rest that tells nothing"
_OFFSET = "offset_voltage"
_FEW = 3  # samples of a rest that shows
_CLEAR = 0.1  # of the input's range: what sets a shaft off, rather than the last digit of a measured voltage
_FLICKERS = 1.5  # counts: a shaft that stands at the edge of one
_CREEPS = 2.0  # counts: how far the model's shaft gets in the rest at most
_COULD_CREEP = 5.0  # counts: the same at the speed that it creeps at in the end
_NEARLY = 0.5  # of the friction that would hold it is there
_ABOVE = 1.0 + 1e-6  # times what holds the shaft


def with_creeping_rest(fit: Fit) -> Fit:
    """Return the fit with a line of its budget where the model creeps through a rest in which no count changes; else the same."""
    names = set(fit.model.names)
    if not fit.model.structure.friction or not {"gain", FRICTION, _OFFSET, "time_constant"} <= names:
        return fit
    creeping = [
        each for each in (_friction_to_stand(fit, record) for record in fit.records) if each is not None
    ]
    if not creeping or not fit.residual_sd > 0:
        return fit
    jacobian, e = innovations_and_jacobian(fit)
    variance = float(e @ e) / max(len(e) - jacobian.shape[1], 1)
    standing, _ = innovations_and_jacobian(_at_rest(fit, _ABOVE * max(creeping)))
    reason = (
        "the model creeps through a rest in which no count changes, by a count or so, and that says nothing of friction and "
        "offset"
    )
    added = beyond(*(covariance_with_priors(fit, each, variance) for each in (standing, jacobian)))
    return fit.widen(Contribution(source=SOURCE, covariance=added, reason=reason))


def _friction_to_stand(fit: Fit, record: FittedRecord) -> float | None:
    """The Coulomb friction [input unit] that just holds the model's shaft in a rest through which it creeps; else None.

    A shaft that has only begun to move, as the input drives it from the first row on, lacks far more friction than that.
    """
    data = record.data
    rest = _rest(data)
    if not rest.any():
        return None
    count = _count(data)
    friction, needed = fit.model[FRICTION], _friction_that_holds(fit, record, rest)
    gone = abs(fit.model["gain"]) * (needed - friction) * float(np.ptp(data.t_output[rest]))
    within = np.ptp(record.prediction[rest]) < _CREEPS * count and gone < _COULD_CREEP * count
    creeps = within and _NEARLY * needed < friction < needed
    return needed if creeps else None


def _friction_that_holds(fit: Fit, record: FittedRecord, rest: NDArray[np.bool_]) -> float:
    """The Coulomb friction [input unit] that holds the shaft in the rest of a record, beside what else holds or pulls it."""
    value = dict(zip(fit.model.names, map(float, fit.model.theta), strict=True))
    angle = float(record.prediction[0])
    sine, cosine = value.get("gravity_voltage_sine", 0.0), value.get("gravity_voltage_cosine", 0.0)
    gravity = sine * np.sin(angle) + cosine * np.cos(angle)
    held = value.get("stribeck_voltage", 0.0) + value.get("load_friction", 0.0) * abs(gravity)
    left = record.data.input_at_output[rest] - value[_OFFSET] - gravity
    return float(np.abs(left).max() - held)


def _at_rest(fit: Fit, friction: float) -> Fit:
    """The same model with so much Coulomb friction [input unit] that it stands in each rest."""
    theta = fit.model.theta.copy()
    theta[fit.model.names.index(FRICTION)] = friction
    records = tuple(
        replace(record, nuisance=_without_speed(fit, record)) if _rest(record.data).any() else record
        for record in fit.records
    )
    return replace(fit, model=replace(fit.model, theta=theta), records=records)


def _without_speed(fit: Fit, record: FittedRecord) -> Array:
    """The nuisance parameters (Q,) of a record that begins at rest."""
    names = [parameter.name for parameter in fit.model.structure.nuisance(record.data)]
    return np.where(np.array(names) == START_SPEED.name, 0.0, record.nuisance)


def _count(data: Dataset) -> float:
    """The step of a position that was counted, in its unit; 0 of another."""
    return float(data.quantum or grid_step(data.y) or 0.0)


@keep_with_data
def _rest(data: Dataset) -> NDArray[np.bool_]:
    """The samples (M,) at the beginning of a record in which no count changes until the input sets the shaft off; else none."""
    changes = np.flatnonzero(np.abs(data.u - data.u[0]) > _CLEAR * np.ptp(data.u))
    if data.kind == "position" and len(changes) and rests_at_first(data):
        rest = data.t_output <= data.t_input[changes[0]]
        if np.count_nonzero(rest) > _FEW and np.ptp(data.y[rest]) < _FLICKERS * _count(data):
            return np.asarray(rest)
    return np.zeros(len(data.y), dtype=bool)

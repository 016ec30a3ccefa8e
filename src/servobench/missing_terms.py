"""Is something missing from the model's structure? A score test for each term that motors are known to have and a model may lack.

Each term is an extra input e(t) that depends on what the motor does: what it would add to the output is a column c beside the
Jacobian J. If the structure is right, the innovations r (of unit variance) have no part of c that J can't have as well:

    t = c⊥·r / |c⊥|,   c⊥ = c - J (J'J)⁻¹ J'c

is standard normal (Rao 1948). No parameter is fitted again. The rounding of an ideal encoder is not quite white, which is why the
limit lies well above what chance gives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from servobench.channels import Array
from servobench.estimators.base import Fit, FittedRecord
from servobench.estimators.covariance import andrews_lag, long_run
from servobench.estimators.disturbance import whitened
from servobench.finding import Finding, warning

_LIMIT = 5.0  # standard deviations
_SMALL = 1e-4  # of the largest input: the size of the extra input, small enough for the response to be linear in it


@dataclass(frozen=True)
class Term:
    """A term that a model may lack: its finding's code, a sentence, and e from input and speed, each over its largest value."""

    code: str
    sentence: str
    extra: Callable[[Array, Array], Array]


TERMS = (
    Term(
        "friction-depends-on-speed",
        "Friction is not the same at all speeds: near standstill it differs from what the model takes everywhere (Stribeck), "
        "which moves gain and time constant.",
        lambda _u, w: -np.sign(w) * np.exp(-np.abs(w) / 0.1),
    ),
    Term(
        "drag-not-linear",
        "The speed doesn't follow the input in proportion: drag grows faster or slower than the speed, so that the gain "
        "belongs to this range of speeds only.",
        lambda _u, w: -w * np.abs(w),
    ),
    Term(
        "directions-differ",
        "The motor answers differently in its two directions; one gain for both is a mean of the two.",
        lambda u, w: u * np.sign(w),
    ),
)


def missing_terms(fit: Fit) -> list[Finding]:
    """Return a finding for each term that the data ask for and the structure lacks."""
    largest = max(float(np.abs(record.data.u).max(initial=0.0)) for record in fit.records)
    if largest == 0 or not np.isfinite(fit.residual_sd) or fit.residual_sd == 0:
        return []
    jacobians = [_jacobian(fit, record) for record in fit.records]
    innovations = [record.innovations[record.valid] for record in fit.records]
    found = []
    for term in TERMS:
        columns = [_column(fit, record, term, largest) for record in fit.records]
        size = _score(columns, jacobians, innovations, len(fit.model.theta))
        if abs(size) > _LIMIT:
            sentence = f"{term.sentence} ({abs(size):.0f} standard deviations.)"
            found.append(warning(term.code, sentence, parameters=("gain", "time_constant")))
    return found


def _column(fit: Fit, record: FittedRecord, term: Term, largest: float) -> Array:
    """What the term adds to the innovations of a record, (valid,), from the response to a small extra input."""
    data = record.data
    speed = record.prediction if data.kind == "speed" else np.gradient(record.prediction, data.t_output)
    t = np.union1d(data.t_input, data.t_output)
    held = np.searchsorted(data.t_input, t, side="right") - 1
    u = np.where(held >= 0, data.u[np.maximum(held, 0)], data.input_before)
    top = float(np.abs(speed).max(initial=0.0)) or 1.0
    e = term.extra(u / largest, np.interp(t, data.t_output, speed) / top)
    theta = np.concatenate([fit.model.theta, record.nuisance])
    plain = replace(data, t_input=t, u=u)
    driven = replace(data, t_input=t, u=u + _SMALL * largest * e)
    added = fit.model.structure.predict(theta, driven).y - fit.model.structure.predict(theta, plain).y
    return _in_innovations(fit, record, added)


def _jacobian(fit: Fit, record: FittedRecord) -> Array:
    theta = np.concatenate([fit.model.theta, record.nuisance])
    return _in_innovations(fit, record, fit.model.structure.predict(theta, record.data).jacobian)


def _in_innovations(fit: Fit, record: FittedRecord, x: Array) -> Array:
    """Columns of the output as columns of the innovations, the valid samples of them."""
    if fit.disturbance is None:
        return np.asarray(x[record.valid] / fit.residual_sd, dtype=np.float64)
    theta = np.concatenate([fit.model.theta, record.nuisance])
    sliding = fit.model.structure.sliding(theta, record.data)
    return whitened(x, record.data, sliding, fit.disturbance)[record.valid]


def _score(columns: list[Array], jacobians: list[Array], innovations: list[Array], shared: int) -> float:
    """t of a term over all records; its spread is the larger of that for white innovations and that for their own colour."""
    column, jacobian = np.concatenate(columns), _joint(jacobians, shared)
    norm = float(np.linalg.norm(column))
    if norm == 0 or not np.isfinite(norm):
        return 0.0
    scale = np.linalg.norm(jacobian, axis=0)
    basis = jacobian[:, scale > 0] / scale[scale > 0]
    rest = column - basis @ np.linalg.lstsq(basis, column, rcond=1e-12)[0]
    # What is left of a column that the Jacobian explains is rounding error.
    if float(np.linalg.norm(rest)) <= 1e-6 * norm:
        return 0.0
    score = rest * np.concatenate(innovations)
    spread = max(float(rest @ rest), float(long_run(score[:, None], andrews_lag(score[:, None]))[0, 0]))
    return float(score.sum() / np.sqrt(spread))


def _joint(jacobians: list[Array], shared: int) -> Array:
    """The Jacobian of all records: shared parameters in the same columns, each record's own beside them."""
    own = [jacobian.shape[1] - shared for jacobian in jacobians]
    out = np.zeros((sum(len(jacobian) for jacobian in jacobians), shared + sum(own)))
    row, place = 0, shared
    for jacobian, count in zip(jacobians, own, strict=True):
        rows = slice(row, row + len(jacobian))
        out[rows, :shared] = jacobian[:, :shared]
        out[rows, place : place + count] = jacobian[:, shared:]
        row, place = row + len(jacobian), place + count
    return out

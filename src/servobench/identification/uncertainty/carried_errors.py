"""What errors of the output that last for a whole record, or a stretch of it, make of the parameters.

An error that doesn't change sign from sample to sample isn't averaged out, however many there are. Each one e (M,) is carried
through the normal equations by itself (JCGM 100:2008, 5.1),

    Δθ = (J'J)⁻¹ J' e

and errors that know nothing of each other add up as squares.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.least_squares import Layout, information, jacobian_and_residual

_ALONG = 1e-10  # of the largest curvature: along a valley that is flatter nothing is known
_WORTH_A_LINE = 0.05  # of a parameter's standard deviation


def covariance_of_errors(fit: Fit, errors: Sequence[Sequence[Array]]) -> Array:
    """Return the covariance (P, P) of the shared parameters for errors (M,) of each record, one standard deviation each.

    Errors are in the unit of the output; there has to be at least one.
    """
    layout = Layout(fit.model.structure, tuple(record.data for record in fit.records))
    squares, pulls = [], []
    for record, at, own in zip(fit.records, layout.columns(), errors, strict=True):
        theta = np.concatenate([fit.model.theta, record.nuisance])
        usual = fit.model.structure.predict(theta, record.data)
        jacobian, _ = jacobian_and_residual(record.data, usual)
        squares.append(jacobian.T @ jacobian)
        for error in own:
            pull = np.zeros(len(fit.vector))
            pull[at] = error[usual.valid] @ jacobian
            pulls.append(pull)
    shared = moves_of(np.array(pulls), information(layout, squares))[:, : layout.shared]
    return np.asarray(shared.T @ shared)


def moves_of(pulls: Array, h: Array) -> Array:
    """Return the moves (N, P + ΣQ) of the joint vector that `pulls` cause.

    `pulls` are J'e (N, P + ΣQ) and `h` is J'J (P + ΣQ, P + ΣQ), both in the squared unit of the output, by the parameters' units.
    Where a sum of parameters isn't determined, the least move explains an error as well as any: a known combination has it.
    """
    scale = np.sqrt(np.where(np.diag(h) > 0.0, np.diag(h), 1.0))
    pseudo = np.linalg.pinv(h / np.outer(scale, scale), rcond=_ALONG, hermitian=True)
    return np.asarray(pulls / scale @ pseudo / scale)


def with_line(fit: Fit, source: str, covariance: Array, reason: str, freedom: float) -> Fit:
    """Return the fit with a line for a covariance (P, P); the same where that adds nothing to what is known.

    What counts is any combination of parameters: of a gain and a friction that are known together only, the speed they make.
    """
    if not _matters(fit.covariance, covariance):
        return fit
    usable = np.diag(fit.covariance) > 0
    covariance = np.where(np.outer(usable, usable), covariance, 0.0)
    return fit.widen(Contribution(source=source, covariance=covariance, reason=reason, freedom=freedom))


def _matters(own: Array, added: Array) -> bool:
    """Whether a covariance (P, P) is worth a line beside a fit's own in some direction."""
    known = np.isfinite(np.diag(own)) & (np.diag(own) > 0)
    if not known.any():
        return bool(np.any(np.diag(added) > 0))
    part = np.ix_(known, known)
    scale = np.sqrt(np.outer(np.diag(own)[known], np.diag(own)[known]))
    values, vectors = np.linalg.eigh(own[part] / scale)
    directions = vectors / np.sqrt(np.maximum(values, _ALONG))
    return bool(np.linalg.eigvalsh(directions.T @ (added[part] / scale) @ directions)[-1] > _WORTH_A_LINE**2)

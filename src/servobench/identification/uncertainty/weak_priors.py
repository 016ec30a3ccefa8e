"""Weak priors: what is possible for a parameter at all, where the data tell it only together with another.

The covariance with a normal prior of variance P is (J'J/s² + P⁻¹)⁻¹ (Lindley and Smith 1972).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators import delay_prior
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.sizes import WEAK, sizes
from servobench.identification.uncertainty.score_test import innovations_and_jacobian


def priors(fit: Fit, scale: Array) -> Array:
    """Return the standard deviations (P + ΣQ,) of the priors, in units of the scales.

    They are weak, but for a delay that was taken as loops have it.
    """
    out = np.full(len(scale), WEAK)
    if any(finding.code == delay_prior.CODE for finding in fit.findings):
        data = [record.data for record in fit.records]
        prior = delay_prior.prior_of_delay(fit.model.structure, data)
        if prior is not None:
            out[prior.at] = prior.scale / scale[prior.at]
    return out


def root_of_covariance(fit: Fit, jacobian: Array, scale: Array, variance: float) -> Array:
    """Return R⁻¹ (P + ΣQ, P + ΣQ): the covariance by white noise of that variance is variance R⁻¹R⁻ᵀ, in units of the scales.

    By QR and not by J'J: where two parameters are known together only, differences of huge numbers would come out as variances
    below zero.
    """
    weights = np.sqrt(variance) * np.diag(1.0 / priors(fit, scale))
    triangle = np.linalg.qr(np.vstack([jacobian * scale, weights]), mode="r")
    return np.asarray(np.linalg.inv(triangle), dtype=np.float64)


def covariance_with_priors(fit: Fit, jacobian: Array, variance: float) -> Array:
    """Return the covariance (P, P) of the shared parameters by rows of a Jacobian (N, P + ΣQ), innovations of that variance, and
    the priors.
    """
    scale, shared = sizes(fit)[: jacobian.shape[1]], len(fit.model.names)
    root = root_of_covariance(fit, jacobian, scale, variance) * scale[:, None]
    return np.asarray(variance * (root @ root.T)[:shared, :shared], dtype=np.float64)


def with_weak_priors(fit: Fit) -> Fit:
    """Return the fit of a motor that moved under one level in a direction, with what is known of its parameters together exact.

    Any gain with its own friction makes the same motion there, so that the estimator's covariance has entries of any size, and
    its rounding error is more than what is known. The lines of the budget stay as they are.
    """
    finite = np.isfinite(np.diag(fit.covariance))
    if not {"gain", "time_constant"} <= set(fit.model.names) or not fit.residual_sd > 0:
        return fit
    jacobian, e = innovations_and_jacobian(fit)
    variance = float(e @ e) / max(len(e) - jacobian.shape[1], 1)
    lines = sum((line.covariance for line in fit.budget), np.zeros_like(fit.covariance))
    own = covariance_with_priors(fit, jacobian, variance) + lines
    return replace(fit, covariance=np.where(np.outer(finite, finite), own, fit.covariance), intervals={})

"""The colour of residuals as an autoregression, and its effect on the variance of instruments times noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array


def autoregression(residuals: Sequence[Array]) -> tuple[Array, float]:
    """Return φ (p,) and the variance of e in r_k = Σ φ_i r_{k-i} + e_k, by least squares over all records (N,) each.

    The order p is that of the lowest Schwarz criterion (1978), up to 10 log₁₀ N.
    """
    total = sum(len(r) for r in residuals)
    most = int(min(10 * np.log10(max(total, 1)), min(len(r) for r in residuals) // 4))
    now = np.concatenate([r[most:] for r in residuals])
    before = np.vstack([_lags(r, most) for r in residuals])
    h, g, power = before.T @ before, before.T @ now, float(now @ now)
    best, criterion = (
        (np.empty(0), power / len(now)),
        len(now) * np.log(power / len(now)) if power > 0 else -np.inf,
    )
    for p in range(1, most + 1):
        phi = np.linalg.lstsq(h[:p, :p], g[:p], rcond=None)[0]
        variance = (power - float(phi @ g[:p])) / len(now)
        schwarz_criterion = len(now) * np.log(variance) + p * np.log(len(now)) if variance > 0 else np.inf
        if schwarz_criterion < criterion:
            best, criterion = (phi, variance), schwarz_criterion
    return best


def noise_power(z: Array, phi: Array, variance: float) -> Array:
    """Return Z'ΓZ (P, P), Γ the covariance matrix of the autoregression and z (N, P) what knows nothing of the noise.

    Γ = σ² H H' with H the response 1/φ; so the rows of Z go through it backwards in time (Söderström and Stoica 1983).
    """
    from scipy.signal import lfilter

    through = lfilter([1.0], np.concatenate([[1.0], -phi]), z[::-1], axis=0)
    return np.asarray(variance * through.T @ through, dtype=np.float64)


def _lags(r: Array, most: int) -> Array:
    return (
        np.column_stack([r[most - lag : len(r) - lag] for lag in range(1, most + 1)])
        if most
        else np.empty((len(r), 0))
    )

"""Covariances of least-squares estimates: the plain one, and one that stays right where residuals are coloured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.channels import Array


def plain(h: Array, residual_variance: float) -> Array:
    """Return s² H⁻¹, right for white residuals of variance s²; H = J'J (P, P)."""
    return residual_variance * inverse(h)


def sandwich(h: Array, scores: Sequence[Array]) -> Array:
    """Return H⁻¹ M H⁻¹ with M the long-run variance of the scores J_k r_k, each record's (N, P).

    M = Γ₀ + Σ (1 - l/(L+1)) (Γ_l + Γ_l'), Bartlett weights (Newey and West 1987), the lag L from the scores' own colour
    (Andrews 1991, equations 6.2 and 6.4, an AR(1) for each parameter).
    """
    bread = inverse(h)
    meat = np.zeros_like(h)
    for s in scores:
        influence = s @ bread
        lag = andrews_lag(influence)
        meat += long_run(s, lag)
    return np.asarray(bread @ meat @ bread, dtype=np.float64)


def conservative(first: Array, second: Array) -> Array:
    """Return the second covariance, scaled so that no standard deviation is below that of the first.

    Where the second says nothing (a few samples, all alike), the first stands.
    """
    small, large = np.diag(first), np.diag(second)
    trusted = large > 1e-6 * small
    ratio = np.sqrt(np.maximum(np.where(trusted, small / np.where(trusted, large, 1.0), 1.0), 1.0))
    out = np.where(np.outer(trusted, trusted), second * np.outer(ratio, ratio), first)
    return np.asarray(out, dtype=np.float64)


def andrews_lag(x: Array) -> int:
    """Return the Bartlett lag that suits series x (N, P), from an AR(1) fitted to each; at most a quarter of N."""
    n = len(x)
    if n < 4:
        return 0
    now, before = x[1:], x[:-1]
    power = np.sum(before**2, axis=0)
    use = power > 0
    rho = np.clip(np.sum(now * before, axis=0)[use] / power[use], -0.999, 0.999)
    # Every parameter counts the same, whatever its unit: weights 1/σ⁴.
    numerator = np.sum(4 * rho**2 / ((1 - rho) ** 6 * (1 + rho) ** 2) * (1 - rho) ** 4)
    denominator = np.sum(np.ones_like(rho))
    alpha = numerator / denominator if denominator else 0.0
    return int(min(np.ceil(1.1447 * (alpha * n) ** (1 / 3)), n // 4))


def inverse(h: Array) -> Array:
    """Return H⁻¹ of a symmetric non-negative matrix, computed in scaled parameters, so that their units don't matter.

    A parameter without any information (a zero on the diagonal) is left out: its row and column are zero. Other directions that
    the data say nothing about get a huge variance.
    """
    informed = np.flatnonzero(np.diag(h) > 0)
    out = np.zeros_like(h)
    part = h[np.ix_(informed, informed)]
    scale = 1.0 / np.sqrt(np.diag(part))
    values, vectors = np.linalg.eigh(part * np.outer(scale, scale))
    values = np.maximum(values, 1e-14 * float(values.max(initial=1e-300)))
    out[np.ix_(informed, informed)] = (vectors / values) @ vectors.T * np.outer(scale, scale)
    return out


def long_run(s: Array, lag: int) -> Array:
    """Return Γ₀ + Σ (1 - l/(lag+1)) (Γ_l + Γ_l') of scores s (N, P), by Fourier transform."""
    n = len(s)
    size = 1 << int(np.ceil(np.log2(max(2 * n, 2))))
    spectrum = np.fft.rfft(s, size, axis=0)
    weights = np.zeros(size)
    weights[: lag + 1] = 1.0 - np.arange(lag + 1) / (lag + 1.0)
    weights[size - lag :] = weights[1 : lag + 1][::-1]
    window = np.fft.rfft(weights).real
    smooth = np.fft.irfft(spectrum * window[:, None], size, axis=0)[:n]
    total = s.T @ smooth
    return np.asarray(0.5 * (total + total.T), dtype=np.float64)

"""Covariances of least-squares estimates: the plain one, and one that stays right if the residuals are coloured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array

_NONE = 1e-290  # of information: the variance is beyond all numbers


def plain(h: Array, residual_variance: float) -> Array:
    """Return s² H⁻¹ (P, P), right for white residuals of variance s²; H = J'J (P, P) in units of the parameters."""
    return residual_variance * inverse(h)


def sandwich(h: Array, scores: Sequence[Array]) -> Array:
    """Return H⁻¹ M H⁻¹ with M the long-run variance of the scores J_k r_k, each record's (N, P), in their units.

    M = Γ₀ + Σ (1 - l/(L+1)) (Γ_l + Γ_l'), Bartlett weights (Newey and West 1987), the lag L from the colour of what the scores do
    to each parameter, H⁻¹ J_k r_k (Andrews 1991, equations 6.2 and 6.4, an AR(1) for each).
    """
    return sandwich_from_bread(inverse(h), scores)


def sandwich_from_bread(bread: Array, scores: Sequence[Array]) -> Array:
    """Return B M B as `sandwich` does, B = H⁻¹ (P, P)."""
    meat = np.zeros_like(bread)
    for s in scores:
        meat += long_run(s, andrews_lag(s @ bread))
    return _between(bread, meat)


def _between(bread: Array, meat: Array) -> Array:
    """B M B, from a root of M: a product of all three has variances below zero where B says next to nothing of a direction."""
    scale = np.sqrt(np.maximum(np.diag(meat), 1e-300))
    values, vectors = np.linalg.eigh(meat / np.outer(scale, scale))
    root = bread @ (vectors * np.sqrt(np.maximum(values, 0.0)) * scale[:, None])
    return np.asarray(root @ root.T, dtype=np.float64)


def sandwich_over(h: Array, scores: Sequence[Array], lags: Sequence[int]) -> Array:
    """Return H⁻¹ M H⁻¹ (P, P) as `sandwich` does, in the same units, for lags that may be a good part of the record.

    Each record's part of M is scaled by `fixed_b`² for b = (L+1)/N, so that value ± 1.96 sd still covers 95 %.
    """
    bread = inverse(h)
    meat = np.zeros_like(h)
    for s, lag in zip(scores, lags, strict=True):
        meat += fixed_b((lag + 1) / len(s)) ** 2 * long_run(s, lag)
    return _between(bread, meat)


def fixed_b(b: float) -> float:
    """Return by how much wider than ± 1.96 sd an interval has to be where the lags are a part b of the record, 0 < b <= 1.

    A long-run variance from so few lags' worth of data is itself uncertain, and too low, as the parameters were fitted to the
    same data. The 97.5 % points of Kiefer and Vogelsang (2005, table 1) for Bartlett weights, over 1.96.
    """
    return 1.0 + (2.9694 * b + 0.4160 * b**2 - 0.5324 * b**3) / 1.96


def conservative(first: Array, second: Array) -> Array:
    """Return the second covariance (P, P), scaled so that no standard deviation is below that of the first.

    Where the second says nothing (a few samples, all alike), the first stands.
    """
    small, large = np.diag(first), np.diag(second)
    trusted = large > 1e-6 * small
    ratio = np.sqrt(np.maximum(np.where(trusted, small / np.where(trusted, large, 1.0), 1.0), 1.0))
    out = np.where(np.outer(trusted, trusted), second * np.outer(ratio, ratio), first)
    return np.asarray(out, dtype=np.float64)


def andrews_lag(x: Array) -> int:
    """Return the Bartlett lag that suits series x (N, P), from an AR(1) fitted to each; at most a quarter of N."""
    from servobench.identification.estimators import kernels

    n = len(x)
    if n < 4:
        return 0
    return int(min(np.ceil(1.1447 * (kernels.andrews_alpha(x) * n) ** (1 / 3)), n // 4))


def inverse(h: Array) -> Array:
    """Return H⁻¹ (P, P) of a symmetric non-negative matrix, computed in scaled parameters, so that their units don't matter.

    A parameter without any information (as good as zero on the diagonal) is left out: its row and column are zero. Other
    directions that the data say nothing about get a huge variance.
    """
    informed = np.flatnonzero(h.diagonal() > _NONE)
    part = h if len(informed) == len(h) else h[np.ix_(informed, informed)]
    scale = 1.0 / np.sqrt(part.diagonal())
    weights = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(part * weights)
    values = np.maximum(values, 1e-14 * float(values.max(initial=1e-300)))
    inverse_of_part = (vectors / values) @ vectors.T * weights
    if part is h:
        return np.asarray(inverse_of_part, dtype=np.float64)
    out = np.zeros_like(h)
    out[np.ix_(informed, informed)] = inverse_of_part
    return out


def long_run(s: Array, lag: int) -> Array:
    """Return Γ₀ + Σ (1 - l/(lag+1)) (Γ_l + Γ_l') of scores s (N, P).

    That is Σ w w' / (lag+1) with w the moving sums of lag+1 scores, the ends included: of two scores that are l apart, lag+1-l of
    the sums hold both.
    """
    from servobench.identification.estimators import kernels

    w = np.empty((len(s) + lag, s.shape[1]))
    kernels.moving_sums(s, lag, w)
    return np.asarray(w.T @ w / (lag + 1), dtype=np.float64)


def effective_samples(residual: Array) -> float:
    """Return how many samples of white noise residuals (N,) are worth: n/κ, κ their long-run variance over their variance.

    Of n samples whose mean varies as that of n/κ white ones, n/κ count.
    """
    power = float(np.sum(residual**2))
    if not power > 0:
        return float(len(residual))
    column = residual[:, None]
    return len(residual) / max(float(long_run(column, andrews_lag(column))[0, 0]) / power, 1.0)

"""The likelihood of positions given an encoder's bins, with Gaussian noise before the rounding.

P = Φ((hi - θ)/s) - Φ((lo - θ)/s)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array


@dataclass(frozen=True, eq=False)
class Bins:
    """The likelihood of positions by bins: Σ ln P, its derivatives by each position (score, information), and by ln s.

    `log_likelihood` is Σ ln P, `score` (M,) is ∂ ln P/∂θ, `information` (M,) is -∂² ln P/∂θ²; `slope` and `curvature` are those
    of Σ ln P by ln s.
    """

    log_likelihood: float
    score: Array
    information: Array
    slope: float
    curvature: float


def bins(x: Array, quantum: float, s: float) -> Bins:
    """Return what bins of width `quantum` say of positions x (M,), counted from the bin's middle, with noise s before rounding.

    By symmetry, with a = (Q/2 - |x|)/s to the nearer edge and b = a - Q/s to the farther one, P = Φ(a) - Φ(b). All is taken from
    ln Φ, so no position is too far off. With λ = φ(a)/P, μ = φ(b)/P and w = aλ - bμ it follows from Φ' = φ, φ' = -x φ:

        ∂ ln P/∂|x| = -(λ - μ)/s,   -∂² ln P/∂x² = ((λ - μ)² + w)/s²,   ∂ ln P/∂ ln s = -w

    The information is between 0 and 1/s²: the noise's variance given the bin is between s² and 0.
    """
    from scipy.special import log_ndtr

    a = (0.5 * quantum - np.abs(x)) / s
    b = a - quantum / s
    log_a, log_b = log_ndtr(a), log_ndtr(b)
    with np.errstate(invalid="ignore"):  # a trial that runs away to infinity: its likelihood refuses it
        log_p = log_a + np.log1p(-np.exp(log_b - log_a))
    log_p_root = log_p + 0.5 * np.log(2 * np.pi)
    near, far = np.exp(-0.5 * a * a - log_p_root), np.exp(-0.5 * b * b - log_p_root)
    a_near, b_far = a * near, b * far
    w, tilt = a_near - b_far, near - far
    return Bins(
        log_likelihood=float(np.sum(log_p)),
        score=np.copysign(tilt / s, -x),
        information=np.clip(tilt * tilt + w, 0.0, 1.0) / s**2,
        slope=-float(np.sum(w)),
        curvature=float(np.sum(w * w - w + a * a * a_near - b * b * b_far)),
    )


def expected_information(x: Array, quantum: float, s: float) -> Array:
    """Return the information of a sample at positions x (M,), counted from the middle of any bin: Σ (∂P/∂θ)²/P over all bins."""
    from scipy.special import ndtr

    out = np.zeros_like(x)
    off = x / quantum - np.round(x / quantum)
    reach = int(np.ceil(6 * s / quantum)) + 1
    for n in range(-reach, reach + 1):
        # By symmetry the bin lies above the position; 0 < P then, and no difference of two ones is taken.
        low = (np.abs(n - off) - 0.5) * quantum / s
        high = low + quantum / s
        p = ndtr(-low) - ndtr(-high)
        slope = (np.exp(-0.5 * low * low) - np.exp(-0.5 * high * high)) / np.sqrt(2 * np.pi)
        out += slope * slope / np.maximum(p, 1e-300)
    return np.asarray(out / s**2, dtype=np.float64)

"""Compiled kernels for the plainest case: gain, time constant and start position of a motor that starts from rest.

    τ dω/dt = -ω + K u,   dθ/dt = ω,   ω(0) = 0,   θ(0) = θ₀

without delay, offset or friction, sampled evenly with the input held between samples, as a simulated motor in an ensemble is. For
K = 1 the exact step over h is, with a = e^(-h/τ), b = 1 - a, g = τ b and the derivatives a' = a h/τ², g' = b - τ a' by τ,

    ω̄ ← a ω̄ + b u,          θ̄ ← θ̄ + g ω̄ + (h - g) u
    ω̄' ← a ω̄' + a' (ω̄ - u),  θ̄' ← θ̄' + g ω̄' + g' (ω̄ - u)

and θ = θ₀ + K θ̄ has the derivatives θ̄, K θ̄' and 1. So one pass gives residual, sensitivities and normal equations, without an
array of its own (derived from the exact response to a held input: Åström and Wittenmark 1997, section 2.3). `models.kernels` does
the same for every first-order structure, at times of any kind.
"""

from __future__ import annotations

import math

import numpy as np

from servobench.core.channels import Array
from servobench.core.compiled import compiled

GAIN, TAU, POSITION = 0, 1, 2
# Of gain and time constant: of a motor that is as the model says, what a smaller step leaves is of the order of its square.
_SETTLED = 1e-5
_NEARLY = 0.03  # of them: near enough to go on with all samples
_PART = 8  # of all samples, one in so many, from the first on


@compiled
def normal_equations(u: Array, y: Array, step: float, p: Array, h: Array, g: Array) -> float:
    """Fill h (3, 3) with J'J and g (3,) with J'r, r = y - θ, and return r'r, for p = (K, τ, θ₀).

    The samples u, y (M,) come every `step` [s], and u[k] holds from sample k to the next one.
    """
    gain, tau, position = p[GAIN], p[TAU], p[POSITION]
    b = -math.expm1(-step / tau)
    a, by_speed = 1.0 - b, tau * b
    by_input = step - by_speed
    da = a * step / (tau * tau)
    dg = b - tau * da
    w = th = wt = tt = 0.0
    rr = thth = thtt = tttt = s_th = s_tt = thr = ttr = s_r = 0.0
    for k in range(len(y)):
        r = (y[k] - position) - gain * th
        rr += r * r
        thth += th * th
        thtt += th * tt
        tttt += tt * tt
        s_th += th
        s_tt += tt
        thr += th * r
        ttr += tt * r
        s_r += r
        v = u[k]
        e = w - v
        tt += by_speed * wt + dg * e
        wt = a * wt + da * e
        th += by_speed * w + by_input * v
        w = a * w + b * v
    h[GAIN, GAIN], h[TAU, TAU], h[POSITION, POSITION] = thth, gain * gain * tttt, float(len(y))
    h[GAIN, TAU] = h[TAU, GAIN] = gain * thtt
    h[GAIN, POSITION] = h[POSITION, GAIN] = s_th
    h[TAU, POSITION] = h[POSITION, TAU] = gain * s_tt
    g[GAIN], g[TAU], g[POSITION] = thr, gain * ttr, s_r
    return rr


@compiled
def fit_from_rest(u: Array, y: Array, step: float, p: Array, most: int) -> int:
    """Move p = (K, τ, θ₀) to the least sum of squares, by Gauss and Newton; return the passes over all samples, or -1.

    τ stays above the sample time `step` [s]. The first eighth of the samples leads nearly there, at an eighth of the cost of a
    pass; where it doesn't, the search begins again at p with all of them. -1 says that it didn't settle in `most` passes over
    all samples. Others as in `normal_equations`.
    """
    start = p.copy()
    part = len(y) // _PART
    if part > 0 and _settle(u[:part], y[:part], step, p, most, _NEARLY) > 0:
        passes = _settle(u, y, step, p, most, _SETTLED)
        if passes > 0:
            return passes
    p[:] = start
    return _settle(u, y, step, p, most, _SETTLED)


@compiled
def _settle(u: Array, y: Array, step: float, p: Array, most: int, settled: float) -> int:
    """Move p until a step is shorter than the part `settled` of gain and time constant; return as `fit_from_rest` does."""
    h, g = np.empty((3, 3)), np.empty(3)
    for n in range(most):
        normal_equations(u, y, step, p, h, g)
        # Cholesky's factors of J'J
        l00 = math.sqrt(h[0, 0])
        l10, l20 = h[1, 0] / l00, h[2, 0] / l00
        l11 = math.sqrt(h[1, 1] - l10 * l10)
        l21 = (h[2, 1] - l20 * l10) / l11
        l22 = math.sqrt(h[2, 2] - l20 * l20 - l21 * l21)
        z0 = g[0] / l00
        z1 = (g[1] - l10 * z0) / l11
        z2 = (g[2] - l20 * z0 - l21 * z1) / l22
        position = z2 / l22
        tau = (z1 - l21 * position) / l11
        gain = (z0 - l10 * tau - l20 * position) / l00
        if not (math.isfinite(gain) and math.isfinite(tau) and math.isfinite(position)):
            return -1
        tau = max(p[TAU] + tau, step) - p[TAU]
        p[GAIN] += gain
        p[TAU] += tau
        p[POSITION] += position
        if abs(gain) < settled * abs(p[GAIN]) and abs(tau) < settled * p[TAU]:
            return n + 1
    return -1

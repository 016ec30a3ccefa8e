"""Compiled kernels of the estimators: the innovations of a motor whose speed is disturbed at random."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled


@compiled
def innovations(
    t: Array,
    tau: float,
    ratio: float,
    moving: Array,
    noise: Array,
    of_position: float,
    of_speed: float,
    x: Array,
    spread: Array,
) -> None:
    """Turn columns x (M, K) into their innovations, each over its standard deviation; the measurement's variance is `noise` (M,).

    The state is (θ, ω): ω decays with τ and is driven by white acceleration of intensity `ratio`, θ is its integral; what is
    measured is `of_position` θ + `of_speed` ω. Where `moving` (M,) is 0 the shaft sticks: its speed is zero and stays so.
    The start state is known, as it is a parameter of its own. `spread` (M,) gets the variances of the innovations.
    A time-varying Kalman filter (Kalman 1960): the times t (M,) [s] need not be regular.
    """
    columns = x.shape[1]
    p11 = p12 = p22 = 0.0
    th = np.zeros(columns)
    w = np.zeros(columns)
    h_last, a, g, q11, q12, q22 = -1.0, 1.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(t)):
        c1 = of_position * p11 + of_speed * p12
        c2 = of_position * p12 + of_speed * p22
        s = of_position * c1 + of_speed * c2 + noise[k]
        spread[k] = s
        g1, g2, scale = c1 / s, c2 / s, 1.0 / math.sqrt(s)
        for n in range(columns):
            e = x[k, n] - of_position * th[n] - of_speed * w[n]
            x[k, n] = e * scale
            th[n] += g1 * e
            w[n] += g2 * e
        p11 -= g1 * c1
        p12 -= g1 * c2
        p22 -= g2 * c2
        if k + 1 == len(t):
            break
        if moving[k + 1] == 0.0:
            p12 = p22 = 0.0
            for n in range(columns):
                w[n] = 0.0
            continue
        h = t[k + 1] - t[k]
        if abs(h - h_last) > 1e-9 * h:
            h_last = h
            z = h / tau
            b = -math.expm1(-z)
            a, g = 1.0 - b, tau * b
            q22 = -0.5 * tau * math.expm1(-2.0 * z)
            q12 = 0.5 * g * g
            # The closed form cancels for short steps, where the series is exact to rounding: its next term is z⁴/30 of the first.
            q11 = (
                h * h * h * (1 / 3 - z / 4 + 7 * z * z / 60 - z * z * z / 24)
                if z < 1e-3
                else tau * tau * (h - 2 * g + q22)
            )
        p11 = p11 + 2.0 * g * p12 + g * g * p22 + ratio * q11
        p12 = a * (p12 + g * p22) + ratio * q12
        p22 = a * a * p22 + ratio * q22
        for n in range(columns):
            th[n] += g * w[n]
            w[n] *= a


@compiled
def autocovariances(x: Array, power: Array, product: Array) -> None:
    """Fill power (P,) with Σ x_k-1² and product (P,) with Σ x_k x_k-1 of each column of x (N, P)."""
    power[:] = 0.0
    product[:] = 0.0
    for k in range(1, len(x)):
        for c in range(x.shape[1]):
            power[c] += x[k - 1, c] * x[k - 1, c]
            product[c] += x[k - 1, c] * x[k, c]


@compiled
def moving_sums(s: Array, lag: int, w: Array) -> None:
    """Fill w (N + lag, P) with the sums of lag + 1 neighbouring rows of s (N, P), those that reach beyond the ends included."""
    total = np.zeros(s.shape[1])
    for k in range(len(w)):
        for c in range(s.shape[1]):
            if k < len(s):
                total[c] += s[k, c]
            if k > lag:
                total[c] -= s[k - lag - 1, c]
            w[k, c] = total[c]


@compiled
def harmonics(periods: Array, count: int) -> Array:
    """Return cosine and sine of each of so many harmonics in turn, as rows (2 count, M), for an angle in periods (M,)."""
    out = np.empty((2 * count, len(periods)))
    for k in range(len(periods)):
        out[0, k], out[1, k] = math.cos(2 * math.pi * periods[k]), math.sin(2 * math.pi * periods[k])
    for m in range(2, 2 * count, 2):
        for k in range(len(periods)):
            out[m, k] = out[m - 2, k] * out[0, k] - out[m - 1, k] * out[1, k]
            out[m + 1, k] = out[m - 1, k] * out[0, k] + out[m - 2, k] * out[1, k]
    return out


@compiled
def add_cycles(x: Array, places: NDArray[np.int64], out: Array, met: NDArray[np.bool_]) -> None:
    """Add each row of x (N, P) to that row of out (M, P) where its place (N,) is in a cycle of M; met (M,) is set there."""
    for k in range(len(x)):
        row = places[k] % len(out)
        met[row] = True
        for c in range(x.shape[1]):
            out[row, c] += x[k, c]


@compiled
def places_on_a_grid(t: Array, usual: float) -> NDArray[np.int64]:
    """Return the place of each time t (M,) [s] on the even grid that suits them best (M,), from 0; `usual` is the median step."""
    counted = np.zeros(len(t))
    for k in range(1, len(t)):
        counted[k] = counted[k - 1] + np.rint((t[k] - t[k - 1]) / usual)
    middle, centre = counted.mean(), t.mean()
    product = square = 0.0
    for k in range(len(t)):
        product += (counted[k] - middle) * (t[k] - centre)
        square += (counted[k] - middle) ** 2
    step = product / square
    first = np.rint((t[0] - centre + step * middle) / step)
    out = np.empty(len(t), dtype=np.int64)
    for k in range(len(t)):
        out[k] = np.int64(np.rint((t[k] - centre + step * middle) / step) - first)
    return out


@compiled
def latest(t: Array, at: Array) -> NDArray[np.int64]:
    """Return the number of the last of times t (N,) [s] that isn't beyond at (M,) [s], for each of those, or -1; both ascend."""
    out, n = np.empty(len(at), dtype=np.int64), 0
    for k in range(len(at)):
        while n < len(t) and t[n] <= at[k]:
            n += 1
        out[k] = n - 1
    return out


@compiled
def find_places(places: NDArray[np.int64], wanted: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of the first of places (N,) that is the same as wanted (M,), for each of those, or -1; both ascend."""
    out, n = np.empty(len(wanted), dtype=np.int64), 0
    for k in range(len(wanted)):
        while n < len(places) and places[n] < wanted[k]:
            n += 1
        out[k] = n if n < len(places) and places[n] == wanted[k] else -1
    return out

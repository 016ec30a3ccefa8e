"""Compiled kernels of the estimators: the innovations of a motor whose speed is disturbed at random."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.identification.estimators.symmetric import invert, solve

# Each term of the series of cosine and sine over the one before and the angle's square, with the sign turned.
_COSINE = tuple(1.0 / ((2 * n - 1) * (2 * n)) for n in range(1, 9))
_SINE = tuple(1.0 / ((2 * n) * (2 * n + 1)) for n in range(1, 9))
_HALVINGS = 45  # of a range of some standard deviations: to the last digits of a number
_NOTHING = 1e-200  # J'J of a parameter without any effect: its inverse is still a number


@compiled
def innovations(
    t: Array,
    tau: float,
    ratio: float,
    left: Array,
    turns: Array,
    noise: Array,
    of_position: float,
    of_speed: float,
    x: Array,
    spread: Array,
) -> None:
    """Turn columns x (M, K) into their innovations, each over its standard deviation; the measurement's variance is `noise` (M,).

    The state is (θ, ω): ω decays with τ and is driven by white acceleration of intensity `ratio`, θ is its integral; what is
    measured is `of_position` θ + `of_speed` ω. Of ω a part `left` (M,) is left at `turns` (M,) [s], before the sample: where it
    is 0 the shaft rests, and no torque moves it.
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
        h, part = t[k + 1] - t[k], left[k + 1]
        if part == 0.0 and p22 == 0.0:
            continue
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
        way, decay, q = g, a, ratio
        if part < 1.0:
            until = math.exp((t[k] - turns[k + 1]) / tau)
            way = tau * (1.0 - until) + part * tau * (until - a)
            decay = part * a
            q = ratio if part > 0.0 else 0.0
        p11 = p11 + 2.0 * way * p12 + way * way * p22 + q * q11
        p12 = decay * (p12 + way * p22) + q * q12
        p22 = decay * decay * p22 + q * q22
        for n in range(columns):
            th[n] += way * w[n]
            w[n] *= decay


@compiled
def mixture_reach(weights: Array, middles: Array, sds: Array, chance: float) -> float:
    """Return how far from zero a mixture of normal distributions (K,) is with that chance only, by halving.

    `weights`, `middles` and `sds` are those of its parts, in standard deviations of the whole about zero, so that Chebyshev's
    inequality says how far it can be at most.
    """
    low, high = 0.0, 1.0 / math.sqrt(chance)
    for _ in range(_HALVINGS):
        far, outside = 0.5 * (low + high), 0.0
        for k in range(len(weights)):
            scale = 1.0 / (math.sqrt(2.0) * sds[k])
            tails = math.erfc((far - middles[k]) * scale) + math.erfc((far + middles[k]) * scale)
            outside += 0.5 * weights[k] * tails
        if outside > chance:
            low = far
        else:
            high = far
    return 0.5 * (low + high)


@compiled
def fill_products(x: Array, out: Array) -> None:
    """Fill out (C, C) with X'X of columns x (N, C), in four sums each, which a processor adds to at once."""
    whole = len(x) - len(x) % 4
    for i in range(x.shape[1]):
        for c in range(i, x.shape[1]):
            s0 = s1 = s2 = s3 = 0.0
            for m in range(0, whole, 4):
                s0 += x[m, i] * x[m, c]
                s1 += x[m + 1, i] * x[m + 1, c]
                s2 += x[m + 2, i] * x[m + 2, c]
                s3 += x[m + 3, i] * x[m + 3, c]
            for m in range(whole, len(x)):
                s0 += x[m, i] * x[m, c]
            out[i, c] = out[c, i] = (s0 + s1) + (s2 + s3)


@compiled
def likelihoods_of_ratios(
    t: Array,
    left: Array,
    turns: Array,
    noise: Array,
    columns: Array,
    ends: NDArray[np.int64],
    places: NDArray[np.int64],
    free: NDArray[np.bool_],
    prior: Array,
    tau: float,
    ratios: Array,
    of_position: float,
    of_speed: float,
    changes: Array,
    inverses: Array,
    variances: Array,
    deviances: Array,
) -> None:
    """Fill changes (T, S), inverses (T, S, S), variances (T,) and deviances (T,) for each of the `ratios` (T,) of q/r.

    The rows (B,) of [residual, Jacobian], `columns` (B, 1 + W), are those of all records, which end before `ends` (R,); their
    Jacobians' columns belong to the joint parameters `places` (R, W), none where that is negative. Others as in `innovations`,
    and in `disturbance.Linearisation`, where the law is.
    """
    size, width = len(free), columns.shape[1]
    x, spread, sums = np.empty_like(columns), np.empty(len(columns)), np.empty((width, width))
    h, g = np.empty((size, size)), np.empty(size)
    for n in range(len(ratios)):
        for m in range(len(columns)):
            for i in range(width):
                x[m, i] = columns[m, i]
        h[:], g[:] = 0.0, 0.0
        for i in range(size):
            h[i, i] = prior[i]
        logarithms, begin = 0.0, 0
        for r in range(len(ends)):
            part = slice(begin, ends[r])
            innovations(
                t[part],
                tau,
                ratios[n],
                left[part],
                turns[part],
                noise[part],
                of_position,
                of_speed,
                x[part],
                spread[part],
            )
            for m in range(begin, ends[r]):
                logarithms += math.log(spread[m])
            fill_products(x[part], sums)
            for i in range(1, width):
                at = places[r, i - 1]
                if at >= 0 and free[at]:
                    g[at] += sums[0, i]
                    for k in range(1, width):
                        other = places[r, k - 1]
                        if other >= 0 and free[other]:
                            h[at, other] += sums[i, k]
            begin = ends[r]
        count = 0
        for i in range(size):
            if not free[i]:
                h[i, i] = 0.0
            count += h[i, i] != 0.0
        logarithms += invert(h, inverses[n])
        for i in range(size):
            changes[n, i] = 0.0
            for k in range(size):
                changes[n, i] += inverses[n, i, k] * g[k]
        squares, begin = 0.0, 0
        for r in range(len(ends)):
            for m in range(begin, ends[r]):
                over = x[m, 0]
                for i in range(1, width):
                    if places[r, i - 1] >= 0:
                        over -= x[m, i] * changes[n, places[r, i - 1]]
                squares += over * over
            begin = ends[r]
        freedom = max(len(columns) - count, 1)
        variances[n] = max(squares / freedom, 1e-300)
        deviances[n] = freedom * math.log(variances[n]) + logarithms


@compiled
def andrews_alpha(x: Array) -> float:
    """Return α(1) of Andrews (1991, equation 6.4) for series x (N, P), from an AR(1) fitted to each.

    Every one counts the same, whatever its unit: weights 1/σ⁴.
    """
    total, used = 0.0, 0
    for c in range(x.shape[1]):
        power = product = 0.0
        for k in range(1, len(x)):
            power += x[k - 1, c] * x[k - 1, c]
            product += x[k - 1, c] * x[k, c]
        if power > 0.0:
            rho = min(max(product / power, -0.999), 0.999)
            total += 4.0 * rho * rho / ((1.0 - rho) * (1.0 + rho)) ** 2
            used += 1
    return total / used if used else 0.0


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
def on_the_circle(periods: float) -> tuple[float, float]:
    """Return cosine and sine of an angle in periods, by their series within an eighth of one: eight angles at a time."""
    part = periods - np.rint(periods)
    quarters = np.rint(4.0 * part)
    z = 2.0 * math.pi * (part - 0.25 * quarters)
    x, c, s = z * z, 1.0, 1.0
    for n in range(8, 0, -1):
        c = 1.0 - _COSINE[n - 1] * x * c
        s = 1.0 - _SINE[n - 1] * x * s
    s *= z
    odd = quarters * quarters == 1.0
    sign = 1.0 if quarters == 0.0 else -1.0
    return (-quarters * s, quarters * c) if odd else (sign * c, sign * s)


@compiled
def harmonics(periods: Array, count: int) -> Array:
    """Return cosine and sine of each of so many harmonics in turn, as rows (2 count, M), for an angle in periods (M,)."""
    out = np.empty((2 * count, len(periods)))
    for k in range(len(periods)):
        out[0, k], out[1, k] = on_the_circle(periods[k])
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
    middle = centre = product = square = 0.0
    for k in range(len(t)):
        middle += counted[k] / len(t)
        centre += t[k] / len(t)
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


@compiled
def damped_step(
    information: Array,
    g: Array,
    damping: float,
    theta: Array,
    lower: Array,
    upper: Array,
    moves: NDArray[np.bool_],
    change: Array,
    reached: Array,
) -> tuple[int, float, float]:
    """Fill `change` (P,) with the step s of (H + λ diag H) s = g from theta, cut at the bounds, and `reached` with theta + s.

    Returns how many entries take part, and of the sum of squares by how much the quadratic model foretells that it falls, and
    s'H s. Entries that may not move, are pressed against a bound (lower, upper) or have no effect don't take part: their step
    is 0. They are solved for in scaled parameters, whose H has ones on its diagonal.
    """
    active, scale = np.empty(len(g), dtype=np.int64), np.empty(len(g))
    count = 0
    for n in range(len(g)):
        change[n], reached[n] = 0.0, theta[n]
        pressed = (theta[n] <= lower[n] and g[n] < 0.0) or (theta[n] >= upper[n] and g[n] > 0.0)
        if moves[n] and not pressed and information[n, n] > _NOTHING:
            active[count] = n
            scale[count] = 1.0 / math.sqrt(information[n, n])
            count += 1
    left, step = np.empty((count, count)), np.empty(count)
    for i in range(count):
        step[i] = scale[i] * g[active[i]]
        for k in range(count):
            # In this order: the scales' product alone may be too large for a float.
            left[i, k] = scale[i] * information[active[i], active[k]] * scale[k]
        left[i, i] += damping
    solve(left, step)
    for i in range(count):
        n = active[i]
        reached[n] = min(max(theta[n] + scale[i] * step[i], lower[n]), upper[n])
        change[n] = reached[n] - theta[n]
    along = bend = 0.0
    for i in range(count):
        across = 0.0
        for k in range(count):
            across += information[active[i], active[k]] * change[active[k]]
        along += change[active[i]] * g[active[i]]
        bend += change[active[i]] * across
    return count, 2.0 * along - bend, bend


@compiled
def is_finite(information: Array, cost: float) -> bool:
    """Return whether a cost and all of J'J (P, P) are finite numbers."""
    sound = math.isfinite(cost)
    for i in range(len(information)):
        for k in range(len(information)):
            sound = sound and math.isfinite(information[i, k])
    return sound

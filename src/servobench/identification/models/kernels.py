"""Compiled kernels of the first-order models: the exact response to a held input, with its sensitivities.

    τ dω/dt = -ω + K (u(t - d) - u₀ - u_c sgn(ω)),   dθ/dt = ω

Between two events nothing switches, so state and sensitivities are known in closed form. Events are the changes of the
delayed input, and the instants at which the shaft stops. With a = e^(-h/τ), b = 1 - a, q = a h/τ, a piece that begins h ago has

    θ(h) = θ + τb ω + (h - τb) ω_end + (b - q) c,   ω(h) = a ω + b ω_end + (q/τ) c

for the response itself (c = 0) and for its derivative by any parameter: then θ, ω and ω_end are their derivatives at the
beginning of the piece, and c is ω - ω_end for τ and 0 for the others. So a piece is a matrix x (4, 8): rows θ, ω, ω_end and c,
a column for each derivative and one for the response.

At an event whose instant depends on a parameter the slope of the speed jumps from f⁻ to f⁺, and the sensitivity of the speed with
it: by (f⁻ - f⁺) times the derivative of the instant. For the input that derivative is 1 (by d); for a stop it is -S/f⁻, so
S is scaled by f⁺/f⁻. The angle's slope, the speed, doesn't jump. (Sensitivities of switched systems: Rozenvasser 1967.)

The vector p (7,) is (K, τ, u₀, u_c, d, and angle and speed at the first sample), `total` (8, 8) sums products of the columns, and
inputs u (N,) hold from t_in (N,). Times, lengths h, τ and delays are in s, inputs v in V.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled

# Columns of the Jacobian, and of the parameter vector.
GAIN, TAU, OFFSET, COULOMB, DELAY, POSITION, SPEED = 0, 1, 2, 3, 4, 5, 6
COLUMNS = 7
# The column of a piece that holds the response itself, and its rows.
RESPONSE = 7
ANGLE, RATE, END, EXTRA = 0, 1, 2, 3
# A piece with fewer samples than this is added sample by sample; as one it would take longer.
_FEW = 8
_SAME = 1e-13  # of τ: lengths that are nearer have the same e^(-h/τ), as good as to rounding


@compiled
def slip_state(p: Array, v: float, w: float, friction: float) -> tuple[float, float]:
    """Return the sense of sliding (±1, or 0 at rest) and the speed it tends to, for an input v and a speed w."""
    e = v - p[OFFSET]
    if friction == 0.0:
        return 1.0, p[GAIN] * e
    if w != 0.0:
        sense = math.copysign(1.0, w)
    elif abs(e) <= p[COULOMB]:
        return 0.0, 0.0
    else:
        # The shaft follows the torque, whose sign is that of K e.
        sense = math.copysign(1.0, p[GAIN] * e)
    return sense, p[GAIN] * e - abs(p[GAIN]) * sense * p[COULOMB]


@compiled
def slope(p: Array, v: float, w: float, friction: float) -> float:
    """Return dω/dt for an input v at a speed w."""
    sense, end = slip_state(p, v, w, friction)
    return (end - w) / p[TAU] if sense != 0.0 else 0.0


@compiled
def at_start(p: Array) -> Array:
    """Return the matrix of a piece (4, 8) that begins at the first sample; its last two rows are still empty."""
    x = np.zeros((4, COLUMNS + 1))
    x[ANGLE, POSITION] = x[RATE, SPEED] = 1.0
    x[ANGLE, RESPONSE], x[RATE, RESPONSE] = p[POSITION], p[SPEED]
    return x


@compiled
def first_input(t_in: Array, u: Array, u_before: float, delay: float, t: float) -> tuple[int, float]:
    """Return which input is the first to act at t [s] or later, and the value that holds until then."""
    k, v = 0, u_before
    while k < len(u) and t_in[k] + delay < t:
        v = u[k]
        k += 1
    return k, v


@compiled
def drive_piece(
    x: Array, p: Array, v: float, friction: float, now: float, until: float
) -> tuple[float, bool]:
    """Fill the last two rows of a piece for an input v; return when it ends, `until` or at a stop, and whether it stops."""
    w = x[RATE, RESPONSE]
    sense, end = slip_state(p, v, w, friction)
    if sense == 0.0:
        # A shaft that sticks forgets how it came to rest.
        for c in range(COLUMNS + 1):
            x[RATE, c] = x[END, c] = x[EXTRA, c] = 0.0
        return until, False
    x[END, GAIN] = end / p[GAIN]
    x[END, OFFSET] = -p[GAIN]
    x[END, COULOMB] = -abs(p[GAIN]) * sense * friction
    x[END, RESPONSE] = end
    x[EXTRA, TAU] = w - end
    return stop_time(w, end, p[TAU], friction, now, until)


@compiled
def stop_time(
    w: float, end: float, tau: float, friction: float, now: float, until: float
) -> tuple[float, bool]:
    """Return when a piece ends, `until` or at a stop, and whether it stops; its speed is w at `now` and tends to `end`."""
    if friction != 0.0 and w * end < 0.0:
        # w e^(-h/τ) + end (1 - e^(-h/τ)) = 0
        stop = now + tau * math.log1p(-w / end)
        if stop <= until:
            return stop, True
    return until, False


@compiled
def weights(a: float, h: float, tau: float, speed_out: float) -> tuple[float, float, float, float]:
    """Return what the rows of a piece count for in a sample h after its beginning, a = e^(-h/τ); of the speed or of the angle."""
    b, q = 1.0 - a, a * h / tau
    if speed_out != 0.0:
        return 0.0, a, b, q / tau
    return 1.0, tau * b, h - tau * b, b - q


@compiled
def advance_piece(
    x: Array, p: Array, v: float, following: float, friction: float, h: float, b: float, stops: bool
) -> None:
    """Move a piece on by h to its end, and across the event there: a stop, or a change of the input from v to `following`.

    b is 1 - e^(-h/τ).
    """
    tau = p[TAU]
    a, g = 1.0 - b, tau * b
    q = a * h / tau
    for c in range(COLUMNS + 1):
        x[ANGLE, c] += g * x[RATE, c] + (h - g) * x[END, c]
        x[RATE, c] = a * x[RATE, c] + b * x[END, c]
    x[ANGLE, TAU] += (b - q) * x[EXTRA, TAU]
    x[RATE, TAU] += q / tau * x[EXTRA, TAU]
    if stops:
        x[RATE, RESPONSE] = 0.0
        ratio = slope(p, v, 0.0, friction) * tau / x[END, RESPONSE]
        for c in range(COLUMNS):
            x[RATE, c] *= ratio
    else:
        w = x[RATE, RESPONSE]
        x[RATE, DELAY] += slope(p, v, w, friction) - slope(p, following, w, friction)


@compiled
def response(
    t_in: Array,
    u: Array,
    u_before: float,
    t_out: Array,
    p: Array,
    friction: float,
    speed_out: float,
    columns: NDArray[np.int64],
    y: Array,
    jac: Array,
) -> None:
    """Fill y (M,) and jac (M, C) with the response at t_out (M,) to inputs u (N,) that hold from t_in (N,).

    p (7,) is (K, τ, u₀, u_c, d, θ at t_out[0], ω at t_out[0]), and `columns` (C,) are those of them whose derivatives are wanted;
    friction and speed_out are 1 or 0: whether u_c acts, and whether the speed or the angle is wanted. A sample is latched before
    an input of the same instant acts.
    """
    tau, delay, now, last = p[TAU], p[DELAY], t_out[0], t_out[-1]
    x = at_start(p)
    k, v = first_input(t_in, u, u_before, delay, now)
    row = RATE if speed_out != 0.0 else ANGLE
    y[0] = x[row, RESPONSE]
    for n in range(len(columns)):
        jac[0, n] = x[row, columns[n]]
    m = 1
    d_last, factor, h_last, b = -1.0, 1.0, -1.0, 0.0
    while m < len(t_out):
        while k < len(u) and u[k] == v:
            k += 1
        until = min(t_in[k] + delay, last) if k < len(u) else last
        until, stops = drive_piece(x, p, v, friction, now, until)
        a, before = 1.0, now
        while m < len(t_out) and t_out[m] <= until:
            d = t_out[m] - before
            if abs(d - d_last) > _SAME * tau:
                d_last, factor = d, math.exp(-d / tau)
            a *= factor
            before = t_out[m]
            f0, f1, f2, f3 = weights(a, before - now, tau, speed_out)
            y[m] = f0 * x[0, RESPONSE] + f1 * x[1, RESPONSE] + f2 * x[2, RESPONSE]
            for n in range(len(columns)):
                c = columns[n]
                jac[m, n] = f0 * x[0, c] + f1 * x[1, c] + f2 * x[2, c] + f3 * x[3, c]
            m += 1
        if m < len(t_out):
            following = v if stops else u[k]
            h = until - now
            if abs(h - h_last) > _SAME * tau:
                h_last, b = h, -math.expm1(-h / tau)
            advance_piece(x, p, v, following, friction, h, b, stops)
            k += 0 if stops else 1
            now, v = until, following


@compiled
def motion(
    t_in: Array,
    u: Array,
    u_before: float,
    t_out: Array,
    p: Array,
    friction: float,
    speed_out: float,
    y: Array,
) -> None:
    """Fill y (M,) as `response` does, without any derivative: a fifth of the work where the input changes at each sample."""
    tau, delay, now, last = p[TAU], p[DELAY], t_out[0], t_out[-1]
    th, w = p[POSITION], p[SPEED]
    k, v = first_input(t_in, u, u_before, delay, now)
    y[0] = w if speed_out != 0.0 else th
    m = 1
    d_last, factor, h_last, b = -1.0, 1.0, -1.0, 0.0
    while m < len(t_out):
        while k < len(u) and u[k] == v:
            k += 1
        until = min(t_in[k] + delay, last) if k < len(u) else last
        sense, end = slip_state(p, v, w, friction)
        if sense == 0.0:
            w = 0.0
        until, stops = stop_time(w, end, tau, friction, now, until)
        a, before = 1.0, now
        while m < len(t_out) and t_out[m] <= until:
            d = t_out[m] - before
            if abs(d - d_last) > _SAME * tau:
                d_last, factor = d, math.exp(-d / tau)
            a *= factor
            before = t_out[m]
            g = tau * (1.0 - a)
            y[m] = a * w + (1.0 - a) * end if speed_out != 0.0 else th + g * w + (before - now - g) * end
            m += 1
        h = until - now
        if abs(h - h_last) > _SAME * tau:
            h_last, b = h, -math.expm1(-h / tau)
        th += tau * b * w + (h - tau * b) * end
        w = 0.0 if stops else (1.0 - b) * w + b * end
        if m < len(t_out) and not stops:
            v = u[k]
            k += 1
        now = until


@compiled
def normal(
    t_in: Array,
    u: Array,
    u_before: float,
    t_out: Array,
    y: Array,
    p: Array,
    friction: float,
    speed_out: float,
    columns: NDArray[np.int64],
) -> Array:
    """Return [J r]'[J r] (C + 1, C + 1), r = y - response, without ever holding J; the arguments are those of `response`."""
    tau, delay, now, last = p[TAU], p[DELAY], t_out[0], t_out[-1]
    x = at_start(p)
    k, v = first_input(t_in, u, u_before, delay, now)
    total = np.zeros((COLUMNS + 1, COLUMNS + 1))
    one = x[RATE if speed_out != 0.0 else ANGLE].copy()
    one[RESPONSE] = y[0] - one[RESPONSE]
    add_sample(total, one)
    m = 1
    d_last, a, h_last, b = -1.0, 1.0, -1.0, 0.0
    while m < len(t_out):
        while k < len(u) and u[k] == v:
            k += 1
        until = min(t_in[k] + delay, last) if k < len(u) else last
        until, stops = drive_piece(x, p, v, friction, now, until)
        if m + _FEW < len(t_out) and t_out[m + _FEW] <= until:
            m = add_piece(total, x, t_out, y, m, now, until, tau, speed_out)
        while m < len(t_out) and t_out[m] <= until:
            d = t_out[m] - now
            if abs(d - d_last) > _SAME * tau:
                d_last, a = d, math.exp(-d / tau)
            f0, f1, f2, f3 = weights(a, d, tau, speed_out)
            for c in range(COLUMNS + 1):
                one[c] = f0 * x[0, c] + f1 * x[1, c] + f2 * x[2, c] + f3 * x[3, c]
            one[RESPONSE] = y[m] - one[RESPONSE]
            add_sample(total, one)
            m += 1
        if m < len(t_out):
            following = v if stops else u[k]
            h = until - now
            if abs(h - h_last) > _SAME * tau:
                h_last, b = h, -math.expm1(-h / tau)
            advance_piece(x, p, v, following, friction, h, b, stops)
            k += 0 if stops else 1
            now, v = until, following
    return select_columns(total, columns)


@compiled
def add_piece(
    total: Array,
    x: Array,
    t_out: Array,
    y: Array,
    m: int,
    now: float,
    until: float,
    tau: float,
    speed_out: float,
) -> int:
    """Add what the samples from m until the end of a piece contribute to `total`, as one; return the next m.

    Within a piece J and the response are weighted sums of its four rows, so only the moments of the four weights need adding up.
    """
    squares = m00 = m01 = m02 = m03 = m11 = m12 = m13 = m22 = m23 = m33 = 0.0
    r0 = r1 = r2 = r3 = 0.0
    x0, x1, x2 = x[0, RESPONSE], x[1, RESPONSE], x[2, RESPONSE]
    a, before, d_last, factor = 1.0, now, -1.0, 1.0
    while m < len(t_out) and t_out[m] <= until:
        d = t_out[m] - before
        if abs(d - d_last) > _SAME * tau:
            d_last, factor = d, math.exp(-d / tau)
        a *= factor
        before = t_out[m]
        f0, f1, f2, f3 = weights(a, before - now, tau, speed_out)
        r = y[m] - (f0 * x0 + f1 * x1 + f2 * x2)
        m00, m01, m02, m03 = m00 + f0 * f0, m01 + f0 * f1, m02 + f0 * f2, m03 + f0 * f3
        m11, m12, m13 = m11 + f1 * f1, m12 + f1 * f2, m13 + f1 * f3
        m22, m23, m33 = m22 + f2 * f2, m23 + f2 * f3, m33 + f3 * f3
        r0, r1, r2, r3 = r0 + f0 * r, r1 + f1 * r, r2 + f2 * r, r3 + f3 * r
        squares += r * r
        m += 1
    total[RESPONSE, RESPONSE] += squares
    for i in range(COLUMNS):
        a0, a1, a2, a3 = x[0, i], x[1, i], x[2, i], x[3, i]
        b0 = a0 * m00 + a1 * m01 + a2 * m02 + a3 * m03
        b1 = a0 * m01 + a1 * m11 + a2 * m12 + a3 * m13
        b2 = a0 * m02 + a1 * m12 + a2 * m22 + a3 * m23
        b3 = a0 * m03 + a1 * m13 + a2 * m23 + a3 * m33
        for c in range(i, COLUMNS):
            total[i, c] += b0 * x[0, c] + b1 * x[1, c] + b2 * x[2, c] + b3 * x[3, c]
        total[i, RESPONSE] += a0 * r0 + a1 * r1 + a2 * r2 + a3 * r3
    return m


@compiled
def add_sample(total: Array, one: Array) -> None:
    """Add one one' to the upper triangle of `total` (8, 8)."""
    for i in range(COLUMNS + 1):
        for c in range(i, COLUMNS + 1):
            total[i, c] += one[i] * one[c]


@compiled
def select_columns(total: Array, columns: NDArray[np.int64]) -> Array:
    """Return the symmetric matrix (C + 1, C + 1) of those columns and of the response, from an upper triangle."""
    out = np.empty((len(columns) + 1, len(columns) + 1))
    for i in range(len(out)):
        for n in range(len(out)):
            a = columns[i] if i < len(columns) else RESPONSE
            b = columns[n] if n < len(columns) else RESPONSE
            out[i, n] = total[min(a, b), max(a, b)]
    return out


@compiled
def separable_columns(
    t_in: Array,
    u: Array,
    u_before: float,
    t_sense: Array,
    sense: Array,
    points: Array,
    t_out: Array,
    speed_out: float,
    columns: NDArray[np.int64],
) -> Array:
    """Return what the output is linear in, (T, S, M), at each of the points (T, 2) of τ and d, the delay of the device included.

    Of `columns` (S,) those are the responses at t_out (M,) to the input (GAIN), to its offset (OFFSET) and to friction (COULOMB),
    each for K = 1, and those to the start state. The direction of motion, `sense` (E,) from `t_sense` on, is taken from the data.
    The first of t_out is where the record begins.
    """
    out = np.empty((len(points), len(columns), len(t_out)))
    decay, free = np.empty(len(t_out)), np.empty(len(t_out))
    driven, braked = np.empty((2, len(t_out))), np.empty((2, len(t_out)))
    row = RATE if speed_out != 0.0 else ANGLE
    for n in range(len(points)):
        tau, delay = points[n]
        if n == 0 or tau != points[n - 1, 0]:
            decay[0] = free[0] = 1.0
            h_last = -1.0
            for m in range(1, len(t_out)):
                h = t_out[m] - t_out[m - 1]
                decay[m] = decay[m - 1]
                if abs(h - h_last) > _SAME * tau:
                    h_last, decay[m] = h, math.exp(-h / tau)
                free[m] = free[m - 1] * decay[m]
            if len(sense):
                respond(t_sense, sense, 0, sense[0], 0.0, t_out, tau, decay, braked)
        k, v = first_input(t_in, u, u_before, delay, t_out[0])
        respond(t_in, u, k, v, delay, t_out, tau, decay, driven)
        for c in range(len(columns)):
            offset = 1.0 if columns[c] == OFFSET else 0.0
            for m in range(len(t_out)):
                if columns[c] == GAIN:
                    out[n, c, m] = driven[row, m]
                elif columns[c] == COULOMB:
                    out[n, c, m] = -braked[row, m]
                elif columns[c] == POSITION:
                    out[n, c, m] = 1.0
                elif speed_out != 0.0:
                    out[n, c, m] = free[m] - offset
                else:
                    out[n, c, m] = tau * (1.0 - free[m]) - offset * (t_out[m] - t_out[0])
    return out


@compiled
def respond(
    t_in: Array,
    u: Array,
    k: int,
    v: float,
    delay: float,
    t_out: Array,
    tau: float,
    decay: Array,
    x: Array,
) -> None:
    """Fill x (2, M) with angle and speed at t_out from rest, for K = 1 and no friction, under v until input number k acts.

    decay (M,) is e^(-h/τ) over the step before each sample.
    """
    th = w = 0.0
    now, h_last, b = t_out[0], -1.0, 1.0
    for m in range(len(t_out)):
        until, a = t_out[m], decay[m]
        if k < len(u) and t_in[k] + delay < until:
            while k < len(u) and t_in[k] + delay < until:
                h = t_in[k] + delay - now
                if abs(h - h_last) > _SAME * tau:
                    h_last, b = h, math.exp(-h / tau)
                th, w = hold_step(th, w, v, h, tau, b)
                now, v = now + h, u[k]
                k += 1
            a = math.exp((now - until) / tau)
        th, w = hold_step(th, w, v, until - now, tau, a)
        now = until
        x[ANGLE, m], x[RATE, m] = th, w


@compiled
def hold_step(th: float, w: float, v: float, h: float, tau: float, a: float) -> tuple[float, float]:
    """Return angle and speed after h with an input v, for K = 1 and no friction; a = e^(-h/τ)."""
    g = tau * (1.0 - a)
    return th + g * w + (h - g) * v, a * w + (1.0 - a) * v


@compiled
def lag_input(u: Array, before: float, decays: Array) -> Array:
    """Return inputs u (N,) behind a first-order lag, at their times, from a settled start; decays (N - 1,) are e^(-h/τ)."""
    out = np.empty(len(u))
    out[0] = before
    for k in range(1, len(u)):
        out[k] = u[k - 1] + (out[k - 1] - u[k - 1]) * decays[k - 1]
    return out


@compiled
def separate_costs(moments: Array, shared: int, costs: Array, linear: Array) -> None:
    """Fill costs (T,) and linear (T, S + R O) with the least-squares solutions that moments (R, T, S + O + 1, ...) stand for.

    Each of R records has [A y]'[A y] at each of T points; the first S columns of A are shared, the next O its own, zero where a
    record has fewer. Own columns are swept out of each record, then the shared ones out of the sum (Beaton 1964).
    """
    records, points, width = moments.shape[0], moments.shape[1], moments.shape[2]
    own, y = width - shared - 1, width - 1
    for n in range(points):
        joint = np.zeros((shared + 1, shared + 1))
        scale, size = np.zeros(shared + 1), np.empty(y)
        for r in range(records):
            a = moments[r, n]
            for c in range(shared + 1):
                scale[c] += a[y if c == shared else c, y if c == shared else c]
            for c in range(shared, y):
                size[c] = a[c, c]
            for c in range(shared, y):
                sweep(a, c, size[c])
            for i in range(shared + 1):
                for c in range(shared + 1):
                    joint[i, c] += a[y if i == shared else i, y if c == shared else c]
        for c in range(shared):
            sweep(joint, c, scale[c])
        # What rounding leaves of a perfect fit is no difference between two points.
        costs[n] = max(joint[shared, shared], 1e-13 * scale[shared])
        for i in range(shared):
            linear[n, i] = joint[i, shared]
        for r in range(records):
            a = moments[r, n]
            for c in range(own):
                value = a[shared + c, y]
                for i in range(shared):
                    value -= a[shared + c, i] * linear[n, i]
                linear[n, shared + r * own + c] = value


@compiled
def sweep(a: Array, k: int, scale: float) -> None:
    """Sweep a symmetric matrix (W, W) on column k; one that the others explain to 1e-12 of its size is left out, as zero."""
    pivot = a[k, k]
    if pivot <= 1e-12 * scale:
        a[k, :] = 0.0
        a[:, k] = 0.0
        return
    for c in range(len(a)):
        a[k, c] /= pivot
    for i in range(len(a)):
        if i != k:
            factor = a[i, k]
            for c in range(len(a)):
                a[i, c] -= factor * a[k, c]
            a[i, k] = -factor / pivot
    a[k, k] = 1.0 / pivot

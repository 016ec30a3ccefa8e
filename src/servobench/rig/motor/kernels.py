"""Compiled kernels of the motor: one tick, exact, with the tick split where the shaft stops or turns back.

While the shaft slides one way and the voltage is constant, the motor is linear and its state at any time is known in closed form.
Coulomb friction makes it switch between three such phases: sliding forwards, sliding backwards, stuck. A tick in which the speed
surely doesn't reach zero is one matrix product, with the whole Coulomb torque against the motion; any other is cut at its
switching times.

The coefficients c (33,) are laid out below. The current i is in A, the speed w in rad/s, the angle theta in rad, the voltage v
in V, times are in s.
"""

from __future__ import annotations

import math

from servobench.core.channels import Array
from servobench.core.compiled import strictly_compiled, strictly_inlined

# Layout of the coefficient array `c`, filled by `servobench.rig.motor.solvers.exact`.
R, L, K, J, B, TC, H = 0, 1, 2, 3, 4, 5, 6
A00, A01, B0, A10, A11, B1, T0, T1, TB, C1, G, Q = 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18
# The speed can't reach zero in a tick where s (ω + ω') > PER_AMPERE |i| + PER_VOLT |v| + LEAST, see `tick`.
PER_AMPERE, PER_VOLT, LEAST = 19, 20, 21
# While it slides: A of (i, ω), half its trace M, D² = M² - det A, and the steady i and ω for each volt and each newton metre.
AII, AIW, AWI, AWW, M, D2, DET, I_V, I_T, W_V, W_T = 22, 23, 24, 25, 26, 27, 28, 29, 30, 31, 32
SIZE = 33


@strictly_compiled
def transition(m: float, d2: float, t: float) -> tuple[float, float]:
    """Return (c, s) with e^(A t) = c I + s (A - m I), for a 2 x 2 matrix A with half trace m and d2 = m² - det A.

    It follows from (A - m I)² = d2 I, which is Cayley and Hamilton's theorem.
    """
    if d2 > 0.0:
        d = math.sqrt(d2)
        fast, slow = math.exp((m - d) * t), math.exp((m + d) * t)
        if d * t > 1e-4:
            return 0.5 * (slow + fast), 0.5 * (slow - fast) / d
        return 0.5 * (slow + fast), math.exp(m * t) * t * (1.0 + (d * t) ** 2 / 6.0)
    d = math.sqrt(-d2)
    e = math.exp(m * t)
    if d * t > 1e-4:
        return e * math.cos(d * t), e * math.sin(d * t) / d
    return e * math.cos(d * t), e * t * (1.0 - (d * t) ** 2 / 6.0)


@strictly_compiled
def slide(
    c: Array, i: float, w: float, theta: float, v: float, s: float, t: float
) -> tuple[float, float, float]:
    """Return the state after sliding for a time t with friction opposing the direction s (±1) and a constant voltage v."""
    torque = s * c[TC]
    # Steady state: v = R i + k w and k i = b w + torque.
    w_end = c[W_V] * v - c[W_T] * torque
    i_end = c[I_V] * v + c[I_T] * torque
    if c[L] == 0.0:
        rate = (c[B] + c[K] * c[K] / c[R]) / c[J]
        dw = w - w_end
        w_new = w_end + dw * math.exp(-rate * t)
        theta += w_end * t - dw * math.expm1(-rate * t) / rate
        return (v - c[K] * w_new) / c[R], w_new, theta
    cc, ss = transition(c[M], c[D2], t)
    di, dw = i - i_end, w - w_end
    di_new = cc * di + ss * ((c[AII] - c[M]) * di + c[AIW] * dw)
    dw_new = cc * dw + ss * (c[AWI] * di + (c[AWW] - c[M]) * dw)
    # ∫ dw = row 2 of A^-1 (d(t) - d(0)).
    area = (c[AII] * (dw_new - dw) - c[AWI] * (di_new - di)) / c[DET]
    return i_end + di_new, w_end + dw_new, theta + w_end * t + area


@strictly_compiled
def acceleration(c: Array, i: float, w: float, s: float) -> float:
    """Return the acceleration of a shaft that slides in direction s."""
    return float((c[K] * i - c[B] * w - s * c[TC]) / c[J])


@strictly_compiled
def extremum(c: Array, i: float, w: float, v: float, s: float, t_end: float) -> float:
    """Return the time in (0, t_end) at which the sliding speed has its one extremum, where the acceleration changes its sign."""
    first = acceleration(c, i, w, s)
    low, high = 0.0, t_end
    for _ in range(60):
        middle = 0.5 * (low + high)
        im, wm, _ = slide(c, i, w, 0.0, v, s, middle)
        if acceleration(c, im, wm, s) * first > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@strictly_compiled
def stop_time(
    c: Array, i: float, w: float, v: float, s: float, t_end: float, i_end: float, w_end: float
) -> float:
    """Return the first time in (0, t_end] at which a shaft that slides in direction s comes to rest, or -1 where it doesn't.

    With i_end and w_end it would slide on at t_end.
    """
    low, high = 0.0, t_end
    slowed, speeds_up = s * acceleration(c, i, w, s) < 0.0, s * acceleration(c, i_end, w_end, s) > 0.0
    guess = t_end * w / (w - w_end)  # of a constant acceleration
    if s * w_end > 0.0:  # then it stops only if it is slower in between than at both ends
        if c[L] == 0.0 or w == 0.0 or not (slowed and speeds_up):
            return -1.0
        high = extremum(c, i, w, v, s, t_end)
        _, w_top, _ = slide(c, i, w, 0.0, v, s, high)
        if s * w_top > 0.0:
            return -1.0
        guess = 0.5 * high
    elif s * w <= 0.0:  # it has just started: what turns it back comes after its fastest
        if c[L] == 0.0 or slowed or speeds_up:
            return -1.0
        low = extremum(c, i, w, v, s, t_end)
        guess = 0.5 * (low + high)
    return zero_crossing(c, i, w, v, s, low, high, guess)


@strictly_compiled
def zero_crossing(
    c: Array, i: float, w: float, v: float, s: float, low: float, high: float, guess: float
) -> float:
    """Return the time in (low, high] at which the sliding speed is zero: by Newton's method, halving where that leads out."""
    t, enough = guess, 1e-16 * high
    for _ in range(60):
        if not low < t < high:
            t = 0.5 * (low + high)
        it, wt, _ = slide(c, i, w, 0.0, v, s, t)
        if s * wt > 0.0:
            low = t
        else:
            high = t
        step = wt / acceleration(c, it, wt, s)
        # Its error is squared at each step, so that a step so short needs none after it.
        if abs(step) <= 1e-9 * high:
            return min(high, max(low, t - step))
        if high - low <= enough:
            break
        t -= step
    return high


@strictly_compiled
def breakaway(c: Array, i: float, v: float, t_end: float) -> tuple[float, float]:
    """Return (time, direction) at which a shaft at rest starts to slide; (t_end, 0) where it stays."""
    k, r, l, tc = c[K], c[R], c[L], c[TC]
    if k * abs(i) > tc:
        return 0.0, math.copysign(1.0, i)
    if k * abs(v) / r <= tc:
        return t_end, 0.0
    s = math.copysign(1.0, v)
    if l == 0.0:
        return 0.0, s
    t = l / r * math.log((v / r - i) / (v / r - s * tc / k))
    return (t, s) if t < t_end else (t_end, 0.0)


@strictly_compiled
def advance_switching(
    c: Array, i: float, w: float, theta: float, v: float, t_end: float
) -> tuple[float, float, float]:
    """Return the state after a time t_end with a constant voltage, cut where the shaft stops, turns back or starts."""
    left = t_end
    s = math.copysign(1.0, w)
    # A tick holds a few switches at most; the bound only guards against a loop without end.
    for _ in range(64):
        if w == 0.0:
            t, s = breakaway(c, i, v, left)
            if c[L] == 0.0:
                i = v / c[R]
            elif t > 0.0:
                i = v / c[R] + (i - v / c[R]) * math.exp(-t * c[R] / c[L])
            left -= t
            if s == 0.0 or left <= 0.0:
                return i, 0.0, theta
        i_end, w_end, theta_end = slide(c, i, w, theta, v, s, left)
        t = stop_time(c, i, w, v, s, left, i_end, w_end)
        if t < 0.0:
            return i_end, w_end, theta_end
        i, w, theta = slide(c, i, w, theta, v, s, t)
        w = 0.0
        left -= t
        if left <= 0.0:
            return i, w, theta
    return i, w, theta


@strictly_inlined
def tick(c: Array, i: float, w: float, theta: float, v: float) -> tuple[float, float, float]:
    """Return the state one tick H later with a constant voltage v.

    Where the speed reaches zero within the tick, it changes by |w| + |w'| at least and by H a at most, and is at most M = H a,
    the acceleration being a <= (k |i| + k (|v| + k M)/R + b M + T_c)/J. So a tick with a larger |w| + |w'| has no switch.
    """
    s = 1.0 if w > 0.0 else -1.0
    d = s * c[C1]
    w_new = (c[A10] * i + (c[B1] * v - d)) + c[A11] * w
    if not s * (w + w_new) > c[PER_AMPERE] * abs(i) + (c[PER_VOLT] * abs(v) + c[LEAST]):
        return advance_switching(c, i, w, theta, v, c[H])
    theta += (c[T0] * i + c[T1] * w) + (c[TB] * v - c[Q] * d)
    return (c[A01] * w + (c[B0] * v + c[G] * d)) + c[A00] * i, w_new, theta


@strictly_compiled
def simulate(c: Array, i: float, w: float, theta: float, v: Array, out: Array) -> None:
    """Fill `out` (N + 1, 3) with current, speed and angle at every tick for voltages v (N,), the first row the start.

    The same as one `tick` after the other, with the coefficients in registers, and with what friction does while the shaft slides
    one way, which is constant.
    """
    a00, a01, a10, a11, t0, t1 = c[A00], c[A01], c[A10], c[A11], c[T0], c[T1]
    b0, b1, tb, per_ampere, per_volt, least = c[B0], c[B1], c[TB], c[PER_AMPERE], c[PER_VOLT], c[LEAST]
    out[0, 0], out[0, 1], out[0, 2] = i, w, theta
    n = 0
    while n < len(v):
        s = 1.0 if w > 0.0 else -1.0
        to_i, to_w, to_theta = s * c[G] * c[C1], -s * c[C1], -s * c[Q] * c[C1]
        while n < len(v):
            u = v[n]
            w_new = (a10 * i + (b1 * u + to_w)) + a11 * w
            if not s * (w + w_new) > per_ampere * abs(i) + (per_volt * abs(u) + least):
                break
            theta += (t0 * i + t1 * w) + (tb * u + to_theta)
            i = (a01 * w + (b0 * u + to_i)) + a00 * i
            w = w_new
            n += 1
            out[n, 0], out[n, 1], out[n, 2] = i, w, theta
        if n < len(v):
            i, w, theta = advance_switching(c, i, w, theta, v[n], c[H])
            n += 1
            out[n, 0], out[n, 1], out[n, 2] = i, w, theta

"""Compiled kernels of the position loop: the exact response to a held goal g, with its sensitivities.

    τ dω/dt = -ω + κ (g(t - d) - θ₀ - θ - δ sgn(ω)),   dθ/dt = ω        at rest while |g - θ₀ - θ| <= δ

κ is the loop gain, δ the dead band. Between two events nothing switches. With σ = 1/(2τ), Q = κ/τ, D = Q - σ², the deviation
x = θ - θ_end from θ_end = g - θ₀ - δ sgn(ω), and

    c = e^(-σh) cos(√D h),   s = e^(-σh) sin(√D h)/√D        (cosh and sinh of √-D h where D < 0)

a piece that begins h ago has θ(h) = θ_end + (c + σs) x + s ω,  ω(h) = -Q s x + (c - σs) ω. All of it follows from
ω' = -2σ ω - Q x. The derivatives by κ and τ come through ∂c/∂σ = -h c, ∂s/∂σ = -h s, ∂c/∂D = -h s/2 and ∂s/∂D = (h c - s)/(2D).
At an event whose instant depends on a parameter the sensitivity of the speed jumps as in `models.kernels`.

The vector p (7,) is that of `response`, a state s (3, 8) has the rows listed below. Times and lengths h are in s,
goals v in rad.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.identification.models.kernels import first_input

# Columns of the Jacobian, and of the parameter vector; the last one of a state is the response itself.
LOOP, TAU, OFFSET, DEAD, DELAY, POSITION, SPEED = 0, 1, 2, 3, 4, 5, 6
COLUMNS = 7
RESPONSE = 7
# Rows of a state (3, 8): the angle and the speed at the beginning of a piece, and the angle that it tends to.
ANGLE, RATE, END = 0, 1, 2


@compiled
def sense_of(s: Array, p: Array, v: float, friction: float) -> float:
    """Return the sense of sliding (±1), 0 at rest; without friction it doesn't matter and is 1."""
    if friction == 0.0:
        return 1.0
    w = s[RATE, RESPONSE]
    if w != 0.0:
        return math.copysign(1.0, w)
    error = v - p[OFFSET] - s[ANGLE, RESPONSE]
    return 0.0 if abs(error) <= p[DEAD] else math.copysign(1.0, error)


@compiled
def slope(s: Array, p: Array, v: float, sense: float, friction: float) -> float:
    """Return dω/dt for a goal v and a sense of sliding."""
    if sense == 0.0:
        return 0.0
    error = v - p[OFFSET] - sense * friction * p[DEAD] - s[ANGLE, RESPONSE]
    return float((p[LOOP] * error - s[RATE, RESPONSE]) / p[TAU])


@compiled
def aim(s: Array, p: Array, v: float, sense: float, friction: float) -> None:
    """Fill the last row of a state: where it tends to. A shaft that sticks stays, and forgets how it came to rest."""
    for c in range(COLUMNS + 1):
        s[END, c] = 0.0
    if sense == 0.0:
        for c in range(COLUMNS + 1):
            s[RATE, c], s[END, c] = 0.0, s[ANGLE, c]
        return
    s[END, OFFSET] = -1.0
    s[END, DEAD] = -sense * friction
    s[END, RESPONSE] = v - p[OFFSET] - sense * friction * p[DEAD]


@compiled
def stop_after(s: Array, p: Array) -> float:
    """Return after how long a sliding shaft stops, infinite where it never does."""
    sigma, stiffness = 0.5 / p[TAU], p[LOOP] / p[TAU]
    d = stiffness - sigma * sigma
    w = s[RATE, RESPONSE]
    pull = stiffness * (s[ANGLE, RESPONSE] - s[END, RESPONSE]) + sigma * w
    if d > 0.0:
        r = math.sqrt(d)
        turn = math.atan2(r * w, pull)
        return (turn if turn > 0.0 else turn + math.pi) / r
    if w == 0.0 or pull == 0.0:
        return math.inf
    r = math.sqrt(-d)
    ratio = w / pull
    if ratio <= 0.0 or r * ratio >= 1.0:
        return math.inf
    return ratio if r == 0.0 else math.atanh(r * ratio) / r


@compiled
def shape(p: Array, h: float) -> tuple[float, float, float]:
    """Return c, s and ∂s/∂D of the module's docstring, h after the beginning of a piece."""
    sigma = 0.5 / p[TAU]
    d = p[LOOP] / p[TAU] - sigma * sigma
    z = d * h * h
    if abs(z) < 1e-3:
        # The next terms are below 1e-3⁴/8! of the first.
        e = math.exp(-sigma * h)
        c = e * (1.0 - z / 2.0 * (1.0 - z / 12.0 * (1.0 - z / 30.0)))
        s = e * h * (1.0 - z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0)))
        return c, s, -e * h**3 / 6.0 * (1.0 - z / 10.0 * (1.0 - z / 28.0 * (1.0 - z / 54.0)))
    if d > 0.0:
        r, e = math.sqrt(d), math.exp(-sigma * h)
        c, s = e * math.cos(r * h), e * math.sin(r * h) / r
    else:
        r = math.sqrt(-d)
        slow, quick = math.exp((r - sigma) * h), math.exp(-(r + sigma) * h)
        c, s = 0.5 * (slow + quick), 0.5 * (slow - quick) / r
    return c, s, (h * c - s) / (2.0 * d)


@compiled
def read(s: Array, p: Array, h: float, sense: float, out: Array, row: int) -> None:
    """Fill out (8,) with angle (row 0) or speed (row 1) and its derivatives, h after the beginning of the piece s."""
    if sense == 0.0:
        for n in range(COLUMNS + 1):
            out[n] = s[ANGLE, n] if row == ANGLE else 0.0
        return
    sigma, stiffness = 0.5 / p[TAU], p[LOOP] / p[TAU]
    c, q, q_d = shape(p, h)
    x, w = s[ANGLE, RESPONSE] - s[END, RESPONSE], s[RATE, RESPONSE]
    base = 1.0 if row == ANGLE else 0.0
    of_x = c + sigma * q if row == ANGLE else -stiffness * q
    of_w = q if row == ANGLE else c - sigma * q
    for n in range(COLUMNS + 1):
        out[n] = base * s[END, n] + of_x * (s[ANGLE, n] - s[END, n]) + of_w * s[RATE, n]
    for n in (LOOP, TAU):
        d_stiffness = 1.0 / p[TAU] if n == LOOP else -stiffness / p[TAU]
        d_sigma = 0.0 if n == LOOP else -sigma / p[TAU]
        d_d = d_stiffness - 2.0 * sigma * d_sigma
        dc = -h * c * d_sigma - 0.5 * h * q * d_d
        dq = -h * q * d_sigma + q_d * d_d
        if row == ANGLE:
            out[n] += (dc + d_sigma * q + sigma * dq) * x + dq * w
        else:
            out[n] += -(d_stiffness * q + stiffness * dq) * x + (dc - d_sigma * q - sigma * dq) * w


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
    out: Array,
    jac: Array,
) -> None:
    """Fill out (M,) with the angle or the speed at t_out (M,) for goals u (N,) that hold from t_in (N,), and jac (M, C).

    p (7,) is (κ, τ, θ₀, δ, d, θ at t_out[0], ω at t_out[0]); `columns` (C,) are those of them whose derivatives are wanted;
    friction and speed_out are 1 or 0. A sample is latched before a goal of the same instant acts.
    """
    now, last = t_out[0], t_out[-1]
    k, v = first_input(t_in, u, u_before, p[DELAY], now)
    s = np.zeros((3, COLUMNS + 1))
    s[ANGLE, POSITION] = s[RATE, SPEED] = 1.0
    s[ANGLE, RESPONSE], s[RATE, RESPONSE] = p[POSITION], p[SPEED]
    row = RATE if speed_out != 0.0 else ANGLE
    one, angle, rate = np.empty(COLUMNS + 1), np.empty(COLUMNS + 1), np.empty(COLUMNS + 1)
    m = 0
    while m < len(t_out):
        while k < len(u) and u[k] == v:
            k += 1
        until = min(t_in[k] + p[DELAY], last) if k < len(u) else last
        sense = sense_of(s, p, v, friction)
        aim(s, p, v, sense, friction)
        stops = False
        if friction != 0.0 and sense != 0.0:
            stop = now + stop_after(s, p)
            if stop <= until:
                until, stops = stop, True
        while m < len(t_out) and t_out[m] <= until:
            read(s, p, t_out[m] - now, sense, one, row)
            out[m] = one[RESPONSE]
            for n in range(len(columns)):
                jac[m, n] = one[columns[n]]
            m += 1
        if m == len(t_out):
            return
        read(s, p, until - now, sense, angle, ANGLE)
        read(s, p, until - now, sense, rate, RATE)
        s[ANGLE], s[RATE] = angle, rate
        if stops:
            s[RATE, RESPONSE] = 0.0
            before = slope(s, p, v, sense, friction)
            after = slope(s, p, v, sense_of(s, p, v, friction), friction)
            for c in range(COLUMNS):
                s[RATE, c] *= after / before if before != 0.0 else 0.0
        else:
            following = sense_of(s, p, u[k], friction) if sense == 0.0 else sense
            s[RATE, DELAY] += slope(s, p, v, sense, friction) - slope(s, p, u[k], following, friction)
            v = u[k]
            k += 1
        now = until

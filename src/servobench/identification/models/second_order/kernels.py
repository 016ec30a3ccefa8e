"""Compiled kernels of the second-order motor: the exact response to a held input, with its sensitivities.

In volts, with y = ω/K the voltage that the speed stands for, and e = R i that of the current:

    (τ + τ₂) dy/dt = e - u_c sgn(y)        at rest y = 0 while |e| <= u_c
    τ_e de/dt = u(t - d) - u₀ - e - y,     τ_e = τ τ₂ / (τ + τ₂),     dψ/dt = y

τ and τ₂ are the time constants of the slow and of the fast pole. Between two events nothing switches. Sliding, with
E₁ = e^(-h/τ) and E₂ = e^(-h/τ₂), a piece that begins h ago has

    y(h) = y_end + a₁ E₁ + a₂ E₂,   ψ(h) = ψ + y_end h + a₁ τ (1 - E₁) + a₂ τ₂ (1 - E₂)

A derivative by any parameter has the same form with the derivatives of ψ, y_end, a₁ and a₂, and beside them the derivatives of E₁
by τ and of E₂ by τ₂. So a piece is a matrix x (6, 7): rows ψ, y_end, a₁, a₂, a₁ dτ, a₂ dτ₂, a column for each derivative and one
for the response. The state at an event is a matrix s (3, 7): rows ψ, y and e.

Events are changes of the delayed input, stops, and starts from rest. Where the instant of an event depends on a parameter, a
sensitivity jumps by what the state's slope jumps times that derivative: that of e by (v⁻ - v⁺)/τ_e for the delay, that of y in
proportion to dy/dt after a stop over dy/dt before. At a start dy/dt is zero on both sides (Rozenvasser 1967).

The vector p (6,) is (τ, τ₂, u₀, u_c, d, and y at the first sample). Times and lengths h are in s, inputs v in V.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.identification.models.kernels import first_input

# Columns of the Jacobian, and of the parameter vector; the last one of a piece is the response itself.
TAU, FAST, OFFSET, COULOMB, DELAY, SPEED = 0, 1, 2, 3, 4, 5
COLUMNS = 6
RESPONSE = 6
# Rows of a state, and of a piece.
ANGLE, RATE, TORQUE = 0, 1, 2
END, SLOW, QUICK, SLOW_EXTRA, QUICK_EXTRA = 1, 2, 3, 4, 5


@compiled
def electrical(p: Array) -> float:
    """Return τ_e [s], the time constant of the winding while the shaft is held."""
    return float(p[TAU] * p[FAST] / (p[TAU] + p[FAST]))


@compiled
def at_start(t_in: Array, u: Array, u_before: float, t: float, p: Array) -> Array:
    """Return the state (3, 7) at the first sample, t [s]; y was what it is there while the current followed the inputs before.

    e = u_before - u₀ - y + Σ Δu_k (1 - e^(-(t - d - t_k)/τ_e)), over the changes Δu_k of the input that act before t.
    """
    s = np.zeros((3, COLUMNS + 1))
    s[RATE, SPEED] = 1.0
    s[RATE, RESPONSE] = p[SPEED]
    s[TORQUE, RESPONSE] = u_before - p[OFFSET] - p[SPEED]
    s[TORQUE, OFFSET] = s[TORQUE, SPEED] = -1.0
    winding, before = electrical(p), u_before
    both, k = p[TAU] + p[FAST], 0
    while k < len(u) and t_in[k] + p[DELAY] < t:
        ago = t - p[DELAY] - t_in[k]
        missing = (u[k] - before) * math.exp(-ago / winding)
        s[TORQUE, RESPONSE] += u[k] - before - missing
        s[TORQUE, DELAY] -= missing / winding
        s[TORQUE, TAU] -= missing * ago / winding**2 * (p[FAST] / both) ** 2
        s[TORQUE, FAST] -= missing * ago / winding**2 * (p[TAU] / both) ** 2
        before = u[k]
        k += 1
    return s


@compiled
def sense_of(s: Array, p: Array, friction: float) -> float:
    """Return the sense of sliding (±1), 0 at rest; without friction it doesn't matter and is 1."""
    y, e = s[RATE, RESPONSE], s[TORQUE, RESPONSE]
    if friction == 0.0:
        return 1.0
    if y != 0.0:
        return math.copysign(1.0, y)
    return 0.0 if abs(e) <= p[COULOMB] else math.copysign(1.0, e)


@compiled
def slid(s: Array, p: Array, v: float, brake: float) -> Array:
    """Return the piece (6, 7) that begins in the state s, sliding with an input v; brake is the sense, 0 without friction."""
    tau, fast = p[TAU], p[FAST]
    both, part = tau + fast, tau * fast / (tau - fast)
    x = np.zeros((6, COLUMNS + 1))
    x[END, RESPONSE] = v - p[OFFSET] - brake * p[COULOMB]
    x[END, OFFSET] = -1.0
    x[END, COULOMB] = -brake
    away = s[RATE, RESPONSE] - x[END, RESPONSE]
    rate = (s[TORQUE, RESPONSE] - brake * p[COULOMB]) / both
    for c in range(COLUMNS + 1):
        x[ANGLE, c] = s[ANGLE, c]
        d_away = s[RATE, c] - x[END, c]
        d_rate = s[TORQUE, c] / both
        if c == COULOMB:
            d_rate -= brake / both
        if c == RESPONSE:
            d_away, d_rate = away, rate
        quick = -(d_rate + d_away / tau) * part
        if c == TAU:
            quick += (rate / both + away / tau**2) * part + (rate + away / tau) * (fast / (tau - fast)) ** 2
        elif c == FAST:
            quick += rate / both * part - (rate + away / tau) * (tau / (tau - fast)) ** 2
        x[QUICK, c] = quick
        x[SLOW, c] = d_away - quick
    x[SLOW_EXTRA, TAU] = x[SLOW, RESPONSE]
    x[QUICK_EXTRA, FAST] = x[QUICK, RESPONSE]
    return x


@compiled
def rest_piece(s: Array) -> Array:
    """Return the piece (6, 7) of a shaft that sticks: it forgets how it came to rest."""
    x = np.zeros((6, COLUMNS + 1))
    x[ANGLE] = s[ANGLE]
    return x


@compiled
def weights(w: Array, h: float, p: Array, speed_out: float) -> None:
    """Fill w (6,) with what the rows of a piece count for in a sample h after its beginning; of the speed or of the angle."""
    tau, fast = p[TAU], p[FAST]
    e1, e2 = math.exp(-h / tau), math.exp(-h / fast)
    if speed_out != 0.0:
        w[ANGLE], w[END], w[SLOW], w[QUICK] = 0.0, 1.0, e1, e2
        w[SLOW_EXTRA], w[QUICK_EXTRA] = e1 * h / tau**2, e2 * h / fast**2
    else:
        b1, b2 = -math.expm1(-h / tau), -math.expm1(-h / fast)
        w[ANGLE], w[END], w[SLOW], w[QUICK] = 1.0, h, tau * b1, fast * b2
        w[SLOW_EXTRA], w[QUICK_EXTRA] = b1 - e1 * h / tau, b2 - e2 * h / fast


@compiled
def speed_at(x: Array, h: float, p: Array) -> float:
    """Return y, h after the beginning of a piece."""
    slow, quick = x[SLOW, RESPONSE] * math.exp(-h / p[TAU]), x[QUICK, RESPONSE] * math.exp(-h / p[FAST])
    return float(x[END, RESPONSE] + slow + quick)


@compiled
def first_zero(x: Array, p: Array, sense: float, longest: float) -> float:
    """Return how long after its beginning a piece of that sense stops, a number above `longest` where it doesn't until then.

    y is a constant and two exponentials, so its slope has one zero at most, and y is monotone on either side of it.
    """
    slow, quick = x[SLOW, RESPONSE], x[QUICK, RESPONSE]
    # What rounding leaves of a speed that is zero is no reversal.
    noise = 1e-14 * (abs(x[END, RESPONSE]) + abs(slow) + abs(quick))
    turn, ratio = longest, 0.0
    if slow != 0.0:
        ratio = -quick * p[TAU] / (slow * p[FAST])
    if ratio > 1.0:
        turn = min(longest, math.log(ratio) / (1.0 / p[FAST] - 1.0 / p[TAU]))
    low, high = 0.0, turn
    if sense * speed_at(x, turn, p) >= -noise:
        low, high = turn, longest
        if turn >= longest or sense * speed_at(x, longest, p) >= -noise:
            return 2.0 * longest + 1.0
    return downward_zero(x, p, sense, low, high)


@compiled
def downward_zero(x: Array, p: Array, sense: float, low: float, high: float) -> float:
    """Return the zero of y between low and high, where sense·y falls from 0 or more to below it (Newton within a bracket)."""
    h = 0.5 * (low + high)
    for _ in range(100):
        f = sense * speed_at(x, h, p)
        if f >= 0.0:
            low = h
        else:
            high = h
        slow, quick = x[SLOW, RESPONSE] / p[TAU], x[QUICK, RESPONSE] / p[FAST]
        slope = -sense * (slow * math.exp(-h / p[TAU]) + quick * math.exp(-h / p[FAST]))
        following = h - f / slope if slope != 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - h) <= 1e-15 * p[TAU] or following in (low, high):
            return following
        h = following
    return h


@compiled
def move_on(s: Array, x: Array, p: Array, brake: float, h: float) -> None:
    """Move a sliding state on by h, the length of the piece x that began in it."""
    tau, fast = p[TAU], p[FAST]
    both = tau + fast
    e1, e2 = math.exp(-h / tau), math.exp(-h / fast)
    slope = -(x[SLOW, RESPONSE] / tau * e1 + x[QUICK, RESPONSE] / fast * e2)
    w = np.empty(6)
    for row in range(2):
        weights(w, h, p, float(row))
        for c in range(COLUMNS + 1):
            total = 0.0
            for n in range(6):
                total += w[n] * x[n, c]
            s[row, c] = total
    for c in range(COLUMNS + 1):
        s[TORQUE, c] = -both * (x[SLOW, c] / tau * e1 + x[QUICK, c] / fast * e2)
    s[TORQUE, COULOMB] += brake
    s[TORQUE, RESPONSE] += brake * p[COULOMB]
    s[TORQUE, TAU] += slope - both * x[SLOW, RESPONSE] * e1 * (h / tau - 1.0) / tau**2
    s[TORQUE, FAST] += slope - both * x[QUICK, RESPONSE] * e2 * (h / fast - 1.0) / fast**2


@compiled
def hold_shaft(s: Array, p: Array, v: float, h: float) -> None:
    """Move the state of a shaft that sticks on by h: the current goes on towards e = v - u₀."""
    tau, fast = p[TAU], p[FAST]
    both = tau + fast
    winding = electrical(p)
    decay = math.exp(-h / winding)
    away = s[TORQUE, RESPONSE] - (v - p[OFFSET])
    for c in range(COLUMNS):
        s[RATE, c] = 0.0
        s[TORQUE, c] *= decay
    s[TORQUE, OFFSET] -= 1.0 - decay
    longer = away * decay * h / winding**2
    s[TORQUE, TAU] += longer * (fast / both) ** 2
    s[TORQUE, FAST] += longer * (tau / both) ** 2
    s[RATE, RESPONSE] = 0.0
    s[TORQUE, RESPONSE] = v - p[OFFSET] + away * decay


@compiled
def start_after(s: Array, p: Array, v: float) -> float:
    """Return after how long a shaft that sticks with an input v starts to slide, once |e| is u_c; infinite for never."""
    end, e = v - p[OFFSET], s[TORQUE, RESPONSE]
    sense = math.copysign(1.0, end)
    if abs(end) <= p[COULOMB]:
        return math.inf
    return max(electrical(p) * math.log((end - e) / (end - sense * p[COULOMB])), 0.0)


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
    """Fill out (M,) with ψ [V·s] or y [V] at t_out (M,) for inputs u (N,) that hold from t_in (N,), and jac (M, C).

    p (6,) is (τ, τ₂, u₀, u_c, d, y at t_out[0]); ψ is zero there. `columns` (C,) are those of them whose derivatives are wanted;
    friction and speed_out are 1 or 0. A sample is latched before an input of the same instant acts. Needs τ > τ₂ > 0.
    """
    now, last = t_out[0], t_out[-1]
    k, v = first_input(t_in, u, u_before, p[DELAY], now)
    s = at_start(t_in, u, u_before, now, p)
    sense = sense_of(s, p, friction)
    w = np.empty(6)
    m = 0
    while m < len(t_out):
        while k < len(u) and u[k] == v:
            k += 1
        change = min(t_in[k] + p[DELAY], last) if k < len(u) else last
        brake = sense * friction
        # 0 where the piece ends with a change of the input, 1 with a stop, 2 with a start.
        event, length = 0, change - now
        if sense == 0.0:
            x = rest_piece(s)
            wait = start_after(s, p, v)
            if wait <= length:
                event, length = 2, wait
        else:
            x = slid(s, p, v, brake)
            if friction != 0.0:
                wait = first_zero(x, p, sense, length)
                if wait <= length:
                    event, length = 1, wait
        until = change if event == 0 else now + length
        while m < len(t_out) and t_out[m] <= until:
            weights(w, t_out[m] - now, p, speed_out)
            out[m] = 0.0
            for n in range(6):
                out[m] += w[n] * x[n, RESPONSE]
            for i in range(len(columns)):
                jac[m, i] = 0.0
                for n in range(6):
                    jac[m, i] += w[n] * x[n, columns[i]]
            m += 1
        if m == len(t_out):
            return
        if sense == 0.0:
            hold_shaft(s, p, v, length)
        else:
            move_on(s, x, p, brake, length)
        if event == 0:
            s[TORQUE, DELAY] += (v - u[k]) / electrical(p)
            v = u[k]
            k += 1
        elif event == 1:
            sense = turn_back(s, p, sense)
        else:
            sense = math.copysign(1.0, v - p[OFFSET])
            s[TORQUE, RESPONSE] = sense * p[COULOMB]
        now = until


@compiled
def turn_back(s: Array, p: Array, sense: float) -> float:
    """Bring a shaft that slid in that sense across its stop, and return the sense in which it goes on, 0 where it sticks."""
    e = s[TORQUE, RESPONSE]
    before = e - sense * p[COULOMB]
    following = 0.0 if abs(e) <= p[COULOMB] else math.copysign(1.0, e)
    after = e - following * p[COULOMB] if following != 0.0 else 0.0
    ratio = after / before if before != 0.0 else 0.0
    for c in range(COLUMNS):
        s[RATE, c] *= ratio
    s[RATE, RESPONSE] = 0.0
    return following

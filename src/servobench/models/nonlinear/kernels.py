"""Compiled kernels of the motor with a friction ladder and gravity: the response to a held input, with its sensitivities.

    τ dω/dt = -ω + K (u(t - d) - u₀ - g(θ) - u_a |ω|) - |K| s (u_c + u_s e^(-|ω|/ω_s) + μ |g(θ)|),   dθ/dt = ω
    g(θ) = u_gs sin θ + u_gc cos θ,   s = sgn ω

Between two events (a sample, a change of the delayed input, a stop) the right-hand side is smooth but not linear, so that it is
integrated by the classical scheme of Runge and Kutta (Kutta 1901), fourth order, together with its derivatives by the
parameters: the scheme applied to the variational equations is the exact derivative of the scheme. A step is a tenth of the
shortest time in which anything changes: τ, the growth that falling friction gives, the pendulum's own frequency, the speed as
the rate of sin θ, and the time in which the speed changes by ω_s. One step's error is then below 0.1⁵/120, 1e-7 of what
changes. What hardly changes may be stepped over: beside the turning of a fast shaft, whose swing under gravity is
σ = K g (1 + μ)/(τ ω²) of a radian, a step may be σ^(-1/5) times as long, up to four times, for the same error of the angle.

A stop is where ω, carried on as if it kept its sense, is zero: found by Newton's method on the length of the last step; and so
is the place where gravity changes its side, at which load-dependent friction has a kink. What happens to the sensitivities at
a stop and at a change of the input is told in `models.kernels`. A shaft at rest stays there until the input changes, as gravity
can't while it stands still.

The vector p (13,) is that of `response`, `by` (4, 15) holds the derivatives of the slope at the stages of a step. Angles are in
rad, speeds w in rad/s, steps h in s, inputs v in V.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array
from servobench.compiled import compiled
from servobench.models.kernels import held_before

# Columns of the Jacobian, and of the parameter vector.
GAIN, TAU, OFFSET, COULOMB, DELAY = 0, 1, 2, 3, 4
STRIBECK, STRIBECK_SPEED, SINE, COSINE, LOAD, ASYMMETRY = 5, 6, 7, 8, 9, 10
POSITION, SPEED = 11, 12
COLUMNS = 13
# Rows of what a stage of a step leaves behind: by the columns above, then by the angle and by the speed.
BY_ANGLE, BY_SPEED = 13, 14

_STEP = 0.1  # of the shortest time in which anything changes
_LONGER = 4.0  # times as long may a step be beside the turning of a shaft that gravity hardly moves
_MOST = 100  # steps between two events, for parameters that no motor has
_ENDLESS = (
    20 * _MOST
)  # steps between two samples or changes of the input: such a motor turns round without end
_NEWTON = 30
_BEYOND = 1e100  # speeds and accelerations that parameters lead to under which nothing holds the motor back


@compiled
def at_rest(p: Array, v: float, angle: float, gravity: bool) -> tuple[float, float]:
    """Return the input that is left for a shaft at rest, and how much of it friction can hold."""
    g = p[SINE] * math.sin(angle) + p[COSINE] * math.cos(angle) if gravity else 0.0
    return v - p[OFFSET] - g, p[COULOMB] + p[STRIBECK] + p[LOAD] * abs(g)


@compiled
def side_of(p: Array, angle: float, w: float, gravity: bool) -> float:
    """Return the side that gravity pulls to, ±1; where it is zero, the one that the motion leads to."""
    if not gravity:
        return 1.0
    sine, cosine = math.sin(angle), math.cos(angle)
    g = p[SINE] * sine + p[COSINE] * cosine
    if abs(g) <= 1e-13 * (abs(p[SINE]) + abs(p[COSINE])):
        g = (p[SINE] * cosine - p[COSINE] * sine) * w
    return 1.0 if g >= 0.0 else -1.0


@compiled
def sense_of(p: Array, v: float, angle: float, w: float, friction: bool, gravity: bool) -> float:
    """Return the sense of sliding: ±1, or 0 at rest; without friction it doesn't matter and is 1."""
    if not friction:
        return 1.0
    if w != 0.0:
        return math.copysign(1.0, w)
    left, held = at_rest(p, v, angle, gravity)
    if abs(left) <= held:
        return 0.0
    return math.copysign(1.0, p[GAIN] * left)


@compiled
def slope(
    p: Array,
    v: float,
    sense: float,
    side: float,
    angle: float,
    w: float,
    stribeck: bool,
    gravity: bool,
    by: Array,
) -> float:
    """Return dω/dt while the shaft slides in a sense, gravity pulling to a side (±1), and fill `by` (15,) with its derivatives.

    Beyond a stop it goes on as if |ω| were s ω, and beyond where gravity changes its sign as if it hadn't, so that a step may
    end there.
    """
    gain, tau = p[GAIN], p[TAU]
    brake = abs(gain) * sense / tau
    push = gain / tau
    fast = sense * w
    lost = p[COULOMB]
    by[BY_ANGLE] = 0.0
    by[BY_SPEED] = -1.0 / tau - push * p[ASYMMETRY] * sense
    if stribeck:
        ratio = fast / p[STRIBECK_SPEED]
        falling = math.exp(-max(ratio, -1.0))
        part = p[STRIBECK] * falling
        lost += part
        by[STRIBECK] = -brake * falling
        by[STRIBECK_SPEED] = -brake * part * ratio / p[STRIBECK_SPEED]
        by[BY_SPEED] += brake * sense * part / p[STRIBECK_SPEED]
    left = v - p[OFFSET] - p[ASYMMETRY] * fast
    if gravity:
        sine, cosine = math.sin(angle), math.cos(angle)
        g = p[SINE] * sine + p[COSINE] * cosine
        left -= g
        lost += p[LOAD] * side * g
        weight = -push - brake * p[LOAD] * side
        by[SINE] = weight * sine
        by[COSINE] = weight * cosine
        by[LOAD] = -brake * side * g
        by[BY_ANGLE] = weight * (p[SINE] * cosine - p[COSINE] * sine)
    f: float = push * left - brake * lost - w / tau
    by[GAIN] = (f + w / tau) / gain
    by[TAU] = -f / tau
    by[OFFSET] = -push
    by[COULOMB] = -brake
    by[ASYMMETRY] = -push * fast
    return f


@compiled
def longest_step(p: Array, w: float, f: float, friction: bool, stribeck: bool, gravity: bool) -> float:
    """Return how long a step from a state with speed w and acceleration f may be [s]."""
    size = abs(p[GAIN]) / p[TAU]
    rate = 1.0 / p[TAU] + size * abs(p[ASYMMETRY])
    if gravity:
        g = abs(p[SINE]) + abs(p[COSINE])
        own = size * g * (1.0 + p[LOAD])
        # A step spoils (ω h)⁵ of the swing of a fast shaft, which is `own`/ω² of a radian.
        longer = min(max((w * w / own) ** 0.2, 1.0), _LONGER) if own > 0.0 else _LONGER
        rate += math.sqrt(own) + (abs(w) / longer if g > 0.0 else 0.0)
    h: float = _STEP / rate
    if stribeck and p[STRIBECK] > 0.0:
        ratio = abs(w) / p[STRIBECK_SPEED]
        # Far from rest the term is small, and so is what a step may spoil: its fifth power goes with e^-ratio.
        span = min(_STEP * math.exp(min(0.2 * ratio, 50.0)), _STEP + 0.5 * ratio)
        growth = size * p[STRIBECK] / p[STRIBECK_SPEED]
        h = min(h, span / (abs(f) / p[STRIBECK_SPEED] + growth + rate))
    return h


@compiled
def stages(
    p: Array,
    v: float,
    sense: float,
    side: float,
    angle: float,
    w: float,
    h: float,
    stribeck: bool,
    gravity: bool,
    f1: float,
    by: Array,
) -> tuple[float, float]:
    """Return angle and speed after a step h, and fill `by` (4, 15) with the derivatives of the slope at its last three stages.

    f1 is the slope at its beginning, whose derivatives are in by[0] already.
    """
    w2 = w + 0.5 * h * f1
    f2 = slope(p, v, sense, side, angle + 0.5 * h * w, w2, stribeck, gravity, by[1])
    w3 = w + 0.5 * h * f2
    f3 = slope(p, v, sense, side, angle + 0.5 * h * w2, w3, stribeck, gravity, by[2])
    w4 = w + h * f3
    f4 = slope(p, v, sense, side, angle + h * w3, w4, stribeck, gravity, by[3])
    return angle + h / 6.0 * (w + 2.0 * w2 + 2.0 * w3 + w4), w + h / 6.0 * (f1 + 2.0 * f2 + 2.0 * f3 + f4)


@compiled
def carry(x: Array, columns: NDArray[np.int64], by: Array, h: float) -> None:
    """Move the sensitivities x (2, C) by the columns wanted over a step h whose stages are `by`."""
    a1, a2, a3, a4 = by[0, BY_ANGLE], by[1, BY_ANGLE], by[2, BY_ANGLE], by[3, BY_ANGLE]
    b1, b2, b3, b4 = by[0, BY_SPEED], by[1, BY_SPEED], by[2, BY_SPEED], by[3, BY_SPEED]
    half = 0.5 * h
    for n in range(len(columns)):
        c = columns[n]
        s, r = x[0, n], x[1, n]
        k1 = a1 * s + b1 * r + by[0, c]
        r2 = r + half * k1
        k2 = a2 * (s + half * r) + b2 * r2 + by[1, c]
        r3 = r + half * k2
        k3 = a3 * (s + half * r2) + b3 * r3 + by[2, c]
        r4 = r + h * k3
        k4 = a4 * (s + h * r3) + b4 * r4 + by[3, c]
        x[0, n] = s + h / 6.0 * (r + 2.0 * r2 + 2.0 * r3 + r4)
        x[1, n] = r + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


@compiled
def time_to_event(
    p: Array,
    v: float,
    sense: float,
    side: float,
    angle: float,
    w: float,
    h: float,
    stribeck: bool,
    gravity: bool,
    f1: float,
    by: Array,
    stop: bool,
) -> float:
    """Return the length of the step at whose end the speed (`stop`) or gravity is zero; after h it has another sign."""
    low, high, at = 0.0, h, 0.5 * h
    for _ in range(_NEWTON):
        angle_end, w_end = stages(p, v, sense, side, angle, w, at, stribeck, gravity, f1, by)
        if stop:
            value = w_end * sense
            rate = sense * slope(p, v, sense, side, angle_end, w_end, stribeck, gravity, by[3])
        else:
            sine, cosine = math.sin(angle_end), math.cos(angle_end)
            value = side * (p[SINE] * sine + p[COSINE] * cosine)
            rate = side * (p[SINE] * cosine - p[COSINE] * sine) * w_end
        if value > 0.0:
            low = at
        else:
            high = at
        following = at - value / rate if rate != 0.0 else high
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - at) <= 1e-15 * h:
            break
        at = following
    return at if at > 0.0 else high


@compiled
def response(
    t_in: Array,
    u: Array,
    u_before: float,
    t_out: Array,
    p: Array,
    friction: bool,
    stribeck: bool,
    gravity: bool,
    speed_out: bool,
    columns: NDArray[np.int64],
    y: Array,
    jac: Array,
) -> None:
    """Fill y (M,) and jac (M, C) with the response at t_out (M,) to inputs u (N,) that hold from t_in (N,).

    p (13,) is (K, τ, u₀, u_c, d, u_s, ω_s, u_gs, u_gc, μ, u_a, θ at t_out[0], ω at t_out[0]), and `columns` (C,) are those
    of them whose derivatives are wanted. The flags say which terms act, and whether the speed or the angle is wanted. A sample
    is latched before an input of the same instant acts. Where a motor runs away beyond all numbers, or turns round without end as
    none can (friction that drives), y is infinite from there on.
    """
    count = len(columns)
    x = np.zeros((2, count))
    for n in range(count):
        x[0, n] = 1.0 if columns[n] == POSITION else 0.0
        x[1, n] = 1.0 if columns[n] == SPEED else 0.0
    angle, w, now, delay = p[POSITION], p[SPEED], t_out[0], p[DELAY]
    by, one = np.zeros((4, BY_SPEED + 1)), np.zeros(BY_SPEED + 1)
    k, v = held_before(t_in, u, u_before, delay, now)
    sense = sense_of(p, v, angle, w, friction, gravity)
    side = side_of(p, angle, w, gravity)
    row = 1 if speed_out else 0
    m = 0
    while True:
        if sense == 0.0:
            x[1, :] = 0.0  # a shaft that sticks forgets how it came to rest
        if now >= t_out[m]:
            y[m] = w if speed_out else angle
            for n in range(count):
                jac[m, n] = x[row, n]
            m += 1
            if m == len(t_out):
                return
        while k < len(u) and u[k] == v:
            k += 1
        changes = k < len(u) and t_in[k] + delay < t_out[m]
        until = max(t_in[k] + delay, now) if changes else t_out[m]
        shortest = (until - now) / _MOST
        taken = 0
        while now < until and sense != 0.0:
            f = slope(p, v, sense, side, angle, w, stribeck, gravity, by[0])
            taken += 1
            if taken > _ENDLESS or not abs(w) + abs(f) < _BEYOND:
                y[m:] = np.inf
                jac[m:, :] = 0.0
                return
            h = max(longest_step(p, w, f, friction, stribeck, gravity), shortest)
            left = until - now
            last = h >= left
            h = left if last else left / math.ceil(left / h)
            angle_end, w_end = stages(p, v, sense, side, angle, w, h, stribeck, gravity, f, by)
            stops = friction and w_end * sense < 0.0
            if stops:
                h = time_to_event(p, v, sense, side, angle, w, h, stribeck, gravity, f, by, True)
                angle_end, w_end = stages(p, v, sense, side, angle, w, h, stribeck, gravity, f, by)
            if p[LOAD] != 0.0 and side_of(p, angle_end, w_end, gravity) != side:
                shorter = time_to_event(p, v, sense, side, angle, w, h, stribeck, gravity, f, by, False)
                stops, last = stops and shorter >= h, last and shorter >= h
                h = shorter
                angle_end, w_end = stages(p, v, sense, side, angle, w, h, stribeck, gravity, f, by)
                side = -side
            carry(x, columns, by, h)
            now = until if last and not stops else now + h
            angle, w = angle_end, w_end
            if stops:
                f = slope(p, v, sense, side, angle, 0.0, stribeck, gravity, one)
                w = 0.0
                sense = sense_of(p, v, angle, w, friction, gravity)
                after = 0.0 if sense == 0.0 else slope(p, v, sense, side, angle, w, stribeck, gravity, one)
                for n in range(count):
                    x[1, n] *= after / f if f != 0.0 else 0.0
        now = until
        if changes:
            f = slope(p, v, sense, side, angle, w, stribeck, gravity, one) if sense != 0.0 else 0.0
            v = u[k]
            k += 1
            if w == 0.0:
                sense = sense_of(p, v, angle, w, friction, gravity)
            after = slope(p, v, sense, side, angle, w, stribeck, gravity, one) if sense != 0.0 else 0.0
            for n in range(count):
                if columns[n] == DELAY:
                    x[1, n] += f - after

"""Compiled kernels of the motor with a friction ladder and gravity: the response to a held input, with its sensitivities.

    τ dω/dt = -ω + K (u(t - d) - u₀ - g(θ) - u_a |ω|) - |K| s (u_c + u_s e^(-|ω|/ω_s) + μ |g(θ)|),   dθ/dt = ω
    g(θ) = u_gs sin θ + u_gc cos θ,   s = sgn ω

Between two events (a sample, a change of the delayed input, a stop) the right-hand side is smooth but not linear, so that it is
integrated by the classical scheme of Runge and Kutta (Kutta 1901), fourth order, together with its derivatives by the
parameters: the scheme applied to the variational equations is the exact derivative of the scheme. A step is a tenth of the
shortest time in which anything changes: τ, the growth that falling friction gives, the pendulum's own frequency, the speed as
the rate of sin θ, and the time in which the speed changes by ω_s. One step's error is then below 0.1⁵/120, 1e-7 of what
changes. Small effects allow longer steps: the swing of a fast shaft under gravity is σ = K g (1 + μ)/(τ ω²) of a radian, so a
step may be σ^(-1/5) times as long, up to four times, for the same error of the angle. Without gravity, let the speed be within σ
of its final value, relative to the highest speed so far: a step may be σ^(-1/5) times as long, up to ten times, where the scheme
is still stable. Otherwise time constants below a sample time would take most of a search's time.

A stop is where ω, continued with the same sign, is zero; Newton's method on the length of the last step finds it. The angle at
which gravity changes sign, where load-dependent friction has a kink, is found in the same way. `models.kernels` explains the
sensitivities at a stop and at a change of the input. A shaft at rest stays there until the input changes, because gravity is
constant at rest.

Divisions and sines dominate the cost of a step. So the motor m (21,) is p with derived constants, computed once, and the sine
is updated from sample to sample by the angle-sum formulas.

The vector p (13,) is that of `response`. A step leaves its four stages in `at` (4, 5) and their derivatives in `by` (4, 18).
The sensitivities x (2, 16) are in the order of p with three idle columns: a processor works on four or eight numbers at once.
Angles are in rad, speeds w in rad/s, steps h in s, inputs v in V.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.identification.models.kernels import first_input

# Columns of the Jacobian, and of the parameter vector.
GAIN, TAU, OFFSET, COULOMB, DELAY = 0, 1, 2, 3, 4
STRIBECK, STRIBECK_SPEED, SINE, COSINE, LOAD, ASYMMETRY = 5, 6, 7, 8, 9, 10
POSITION, SPEED = 11, 12
COLUMNS = 13
# What the motor has more: K/τ, |K|/τ, 1/τ, 1/K, 1/ω_s, the square of the pendulum's own frequency [1/s²], and two rates [1/s]
# that bound a step in any state: of all but falling friction, and of that.
PUSH, BRAKE, RATE, PER_GAIN, PER_SPEED, SWING, OWN_RATE, FALL = 13, 14, 15, 16, 17, 18, 19, 20
MOTOR = 21
# What a stage of a step was evaluated at, and its slope; its part of e^(-|ω|/ω_s).
AT_SINE, AT_COSINE, AT_SPEED, AT_FALLING, AT_SLOPE = 0, 1, 2, 3, 4
STATES = 5
# Its derivatives: by the columns above, idle ones, then by the angle and by the speed.
WIDTH = 16
BY_ANGLE, BY_SPEED = 16, 17
STAGE = 18

_STEP = 0.1  # of the shortest time in which anything changes
_LONGER = 4.0  # times as long may a step be beside the turning of a shaft that gravity hardly moves
_LONGEST = (
    10.0  # times as long may it be once the speed has settled: one time constant, and 2.78 would be unstable
)
_MOST = 100  # steps between two events, for parameters that no motor has
_USUAL = 8  # steps for each sample and input that a motor may take on average over a long record
_SHORT = 20_000  # steps that it may take beside those, as for a short record with few samples in each swing
_ENDLESS = (
    20 * _MOST
)  # steps between two samples or changes of the input: such a motor turns round without end
_NEWTON = 30
_BEYOND = 1e100  # speeds and accelerations that parameters lead to under which nothing holds the motor back
_NEAR = 0.5  # rad: a turn within which its series are right to rounding
# Their coefficients, a ratio from each term to the next.
_S1, _S2, _S3, _S4, _S5, _S6 = 1 / 6, 1 / 20, 1 / 42, 1 / 72, 1 / 110, 1 / 156
_C1, _C2, _C3, _C4, _C5, _C6 = 1 / 2, 1 / 12, 1 / 30, 1 / 56, 1 / 90, 1 / 132


@compiled
def motor_of(p: Array) -> Array:
    """Return the motor (21,) for a vector p (13,)."""
    m = np.empty(MOTOR)
    for k in range(COLUMNS):
        m[k] = p[k]
    m[RATE] = 1.0 / p[TAU]
    m[PUSH] = p[GAIN] / p[TAU]
    m[BRAKE] = abs(m[PUSH])
    m[PER_GAIN] = 1.0 / p[GAIN]
    m[PER_SPEED] = 1.0 / p[STRIBECK_SPEED]
    m[SWING] = m[BRAKE] * (abs(p[SINE]) + abs(p[COSINE])) * (1.0 + p[LOAD])
    m[OWN_RATE] = m[RATE] + m[BRAKE] * abs(p[ASYMMETRY]) + math.sqrt(m[SWING])
    m[FALL] = m[BRAKE] * p[STRIBECK] * m[PER_SPEED]
    return m


@compiled
def at_rest(p: Array, v: float, angle: float, gravity: bool) -> tuple[float, float]:
    """Return the input that is left for a shaft at rest, and how much of it friction can hold."""
    g = p[SINE] * math.sin(angle) + p[COSINE] * math.cos(angle) if gravity else 0.0
    return v - p[OFFSET] - g, p[COULOMB] + p[STRIBECK] + p[LOAD] * abs(g)


@compiled
def side_of(p: Array, sine: float, cosine: float, w: float, gravity: bool) -> float:
    """Return the side that gravity pulls to, ±1; where it is zero, the one that the motion leads to."""
    if not gravity:
        return 1.0
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
def of_angle(angle: float, gravity: bool) -> tuple[float, float]:
    """Return sine and cosine of an angle, which matter with gravity only."""
    return (math.sin(angle), math.cos(angle)) if gravity else (0.0, 1.0)


@compiled
def rotate_angle(angle: float, sine: float, cosine: float, by: float, gravity: bool) -> tuple[float, float]:
    """Return sine and cosine of an angle + `by`, from those of the angle, by the sums of angles."""
    if not gravity:
        return sine, cosine
    if not abs(by) < _NEAR:
        return math.sin(angle + by), math.cos(angle + by)
    q = by * by
    s = by * (
        1.0
        - _S1 * q * (1.0 - _S2 * q * (1.0 - _S3 * q * (1.0 - _S4 * q * (1.0 - _S5 * q * (1.0 - _S6 * q)))))
    )
    c = 1.0 - _C1 * q * (
        1.0 - _C2 * q * (1.0 - _C3 * q * (1.0 - _C4 * q * (1.0 - _C5 * q * (1.0 - _C6 * q))))
    )
    return sine * c + cosine * s, cosine * c - sine * s


@compiled
def slope(
    m: Array,
    v: float,
    sense: float,
    side: float,
    sine: float,
    cosine: float,
    w: float,
    stribeck: bool,
    gravity: bool,
) -> tuple[float, float]:
    """Return dω/dt while the shaft slides in a sense, gravity pulling to a side (±1), and e^(-|ω|/ω_s).

    `sine` and `cosine` are those of the angle. Beyond a stop it goes on as if |ω| were s ω, and beyond where gravity changes its
    sign as if it hadn't, so that a step may end there.
    """
    fast = sense * w
    falling = 0.0
    lost = m[COULOMB]
    left = v - m[OFFSET] - m[ASYMMETRY] * fast
    if stribeck:
        falling = math.exp(-max(fast * m[PER_SPEED], -1.0))
        lost += m[STRIBECK] * falling
    if gravity:
        g = m[SINE] * sine + m[COSINE] * cosine
        left -= g
        lost += m[LOAD] * side * g
    return m[PUSH] * left - m[BRAKE] * sense * lost - m[RATE] * w, falling


@compiled
def differentiate(
    m: Array, sense: float, side: float, at: Array, by: Array, stribeck: bool, gravity: bool
) -> None:
    """Fill `by` (4, 18) with the derivatives of `slope` at the stages `at` (4, 5) of a step."""
    brake, push, rate = m[BRAKE] * sense, m[PUSH], m[RATE]
    for k in range(4):
        w, f = at[k, AT_SPEED], at[k, AT_SLOPE]
        fast = sense * w
        by[k, GAIN] = (f + rate * w) * m[PER_GAIN]
        by[k, TAU] = -f * rate
        by[k, OFFSET] = -push
        by[k, COULOMB] = -brake
        by[k, ASYMMETRY] = -push * fast
        by[k, BY_SPEED] = -rate - push * m[ASYMMETRY] * sense
        if stribeck:
            ratio, part = fast * m[PER_SPEED], m[STRIBECK] * at[k, AT_FALLING]
            by[k, STRIBECK] = -brake * at[k, AT_FALLING]
            by[k, STRIBECK_SPEED] = -brake * part * ratio * m[PER_SPEED]
            by[k, BY_SPEED] += brake * sense * part * m[PER_SPEED]
        if gravity:
            sine, cosine = at[k, AT_SINE], at[k, AT_COSINE]
            weight = -push - brake * m[LOAD] * side
            by[k, SINE] = weight * sine
            by[k, COSINE] = weight * cosine
            by[k, LOAD] = -brake * side * (m[SINE] * sine + m[COSINE] * cosine)
            by[k, BY_ANGLE] = weight * (m[SINE] * cosine - m[COSINE] * sine)


@compiled
def longest_step(
    m: Array, w: float, f: float, highest: float, left: float, stribeck: bool, gravity: bool
) -> float:
    """Return how long a step from a state with speed w and acceleration f may be [s].

    `highest` is the highest speed so far, `left` the time until the next event, beyond which no answer matters.
    """
    rate = m[OWN_RATE]
    if not gravity and rate * left > _STEP:
        away = abs(f) / rate
        if away < highest:
            rate /= min((highest / away) ** 0.2, _LONGEST) if away > 0.0 else _LONGEST
    if gravity and m[SINE] * m[SINE] + m[COSINE] * m[COSINE] > 0.0:
        # A step spoils (ω h)⁵ of the swing of a fast shaft, which is `own`/ω² of a radian.
        own, square = m[SWING], w * w
        if square <= own:
            rate += abs(w)
        elif square >= own * _LONGER**5:
            rate += abs(w) / _LONGER
        else:
            rate += abs(w) / (square / own) ** 0.2
    h: float = _STEP / rate
    if stribeck and m[STRIBECK] > 0.0:
        ratio = abs(w) * m[PER_SPEED]
        # Far from rest the term is small, and so is what a step may spoil: its fifth power goes with e^-ratio.
        span = min(_STEP * math.exp(min(0.2 * ratio, 50.0)), _STEP + 0.5 * ratio)
        h = min(h, span / (abs(f) * m[PER_SPEED] + m[FALL] + rate))
    return h


@compiled
def stages(
    m: Array,
    v: float,
    sense: float,
    side: float,
    angle: float,
    h: float,
    stribeck: bool,
    gravity: bool,
    at: Array,
) -> tuple[float, float]:
    """Return angle and speed after a step h, and fill the last three of the stages `at` (4, 5); the first is its beginning."""
    sine, cosine, w, f1 = at[0, AT_SINE], at[0, AT_COSINE], at[0, AT_SPEED], at[0, AT_SLOPE]
    half = 0.5 * h
    w2 = w + half * f1
    s2, c2 = rotate_angle(angle, sine, cosine, half * w, gravity)
    f2, e2 = slope(m, v, sense, side, s2, c2, w2, stribeck, gravity)
    w3 = w + half * f2
    s3, c3 = rotate_angle(angle, sine, cosine, half * w2, gravity)
    f3, e3 = slope(m, v, sense, side, s3, c3, w3, stribeck, gravity)
    w4 = w + h * f3
    s4, c4 = rotate_angle(angle, sine, cosine, h * w3, gravity)
    f4, e4 = slope(m, v, sense, side, s4, c4, w4, stribeck, gravity)
    at[1, AT_SINE], at[1, AT_COSINE], at[1, AT_SPEED], at[1, AT_FALLING], at[1, AT_SLOPE] = s2, c2, w2, e2, f2
    at[2, AT_SINE], at[2, AT_COSINE], at[2, AT_SPEED], at[2, AT_FALLING], at[2, AT_SLOPE] = s3, c3, w3, e3, f3
    at[3, AT_SINE], at[3, AT_COSINE], at[3, AT_SPEED], at[3, AT_FALLING], at[3, AT_SLOPE] = s4, c4, w4, e4, f4
    sixth = h / 6.0
    return angle + sixth * (w + 2.0 * w2 + 2.0 * w3 + w4), w + sixth * (f1 + 2.0 * f2 + 2.0 * f3 + f4)


@compiled
def carry(x: Array, by: Array, h: float) -> None:
    """Move the sensitivities x (2, 16) over a step h whose stages have the derivatives `by` (4, 18)."""
    a1, a2, a3, a4 = by[0, BY_ANGLE], by[1, BY_ANGLE], by[2, BY_ANGLE], by[3, BY_ANGLE]
    b1, b2, b3, b4 = by[0, BY_SPEED], by[1, BY_SPEED], by[2, BY_SPEED], by[3, BY_SPEED]
    half, sixth = 0.5 * h, h / 6.0
    for c in range(WIDTH):
        s, r = x[0, c], x[1, c]
        k1 = a1 * s + b1 * r + by[0, c]
        r2 = r + half * k1
        k2 = a2 * (s + half * r) + b2 * r2 + by[1, c]
        r3 = r + half * k2
        k3 = a3 * (s + half * r2) + b3 * r3 + by[2, c]
        r4 = r + h * k3
        k4 = a4 * (s + h * r3) + b4 * r4 + by[3, c]
        x[0, c] = s + sixth * (r + 2.0 * r2 + 2.0 * r3 + r4)
        x[1, c] = r + sixth * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


@compiled
def time_to_event(
    m: Array,
    v: float,
    sense: float,
    side: float,
    angle: float,
    h: float,
    stribeck: bool,
    gravity: bool,
    at: Array,
    stop: bool,
) -> float:
    """Return the length of the step at whose end the speed (`stop`) or gravity is zero; after h it has another sign."""
    low, high, length = 0.0, h, 0.5 * h
    for _ in range(_NEWTON):
        angle_end, w_end = stages(m, v, sense, side, angle, length, stribeck, gravity, at)
        sine, cosine = of_angle(angle_end, gravity)
        if stop:
            value = w_end * sense
            rate = sense * slope(m, v, sense, side, sine, cosine, w_end, stribeck, gravity)[0]
        else:
            value = side * (m[SINE] * sine + m[COSINE] * cosine)
            rate = side * (m[SINE] * cosine - m[COSINE] * sine) * w_end
        if value > 0.0:
            low = length
        else:
            high = length
        following = length - value / rate if rate != 0.0 else high
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - length) <= 1e-15 * h:
            break
        length = following
    return length if length > 0.0 else high


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
    both: Array,
    jac: Array,
) -> None:
    """Fill both (2, M), angle and speed, and jac (M, C) with the response at t_out (M,) to inputs u (N,), held from t_in (N,).

    p (13,) is (K, τ, u₀, u_c, d, u_s, ω_s, u_gs, u_gc, μ, u_a, θ at t_out[0], ω at t_out[0]), and `columns` (C,) are those
    of them whose derivatives are wanted. The flags say which terms act, and whether the speed or the angle is wanted. A sample
    is latched before an input of the same instant acts. Where a motor runs away beyond all numbers, turns round without end as
    none can (friction that drives), or takes more than 8 steps for each sample and input and 20,000 beside, both are infinite
    from there on.
    """
    count = len(columns)
    x = np.zeros((2, WIDTH))
    x[0, POSITION] = x[1, SPEED] = 1.0
    angle, w, now, delay = p[POSITION], p[SPEED], t_out[0], p[DELAY]
    highest = abs(w)
    motor, at, by = motor_of(p), np.zeros((4, STATES)), np.zeros((4, STAGE))
    k, v = first_input(t_in, u, u_before, delay, now)
    sense = sense_of(p, v, angle, w, friction, gravity)
    sine, cosine = of_angle(angle, gravity)
    side = side_of(p, sine, cosine, w, gravity)
    row = 1 if speed_out else 0
    m = 0
    allowed = _SHORT + _USUAL * (len(t_out) + len(u))
    while True:
        if sense == 0.0:
            x[1, :] = 0.0  # a shaft that sticks forgets how it came to rest
        if now >= t_out[m]:
            both[0, m], both[1, m] = angle, w
            for n in range(count):
                jac[m, n] = x[row, columns[n]]
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
            f, falling = slope(motor, v, sense, side, sine, cosine, w, stribeck, gravity)
            taken += 1
            allowed -= 1
            if taken > _ENDLESS or allowed < 0 or not abs(w) + abs(f) < _BEYOND:
                both[:, m:] = np.inf
                jac[m:, :] = 0.0
                return
            left, highest = until - now, max(highest, abs(w))
            h = max(longest_step(motor, w, f, highest, left, stribeck, gravity), shortest)
            last = h >= left
            h = left if last else left / math.ceil(left / h)
            at[0, AT_SINE], at[0, AT_COSINE], at[0, AT_SPEED] = sine, cosine, w
            at[0, AT_FALLING], at[0, AT_SLOPE] = falling, f
            angle_end, w_end = stages(motor, v, sense, side, angle, h, stribeck, gravity, at)
            stops = friction and w_end * sense < 0.0
            if stops:
                h = time_to_event(motor, v, sense, side, angle, h, stribeck, gravity, at, True)
                angle_end, w_end = stages(motor, v, sense, side, angle, h, stribeck, gravity, at)
            sine, cosine = rotate_angle(angle, sine, cosine, angle_end - angle, gravity)
            crosses = p[LOAD] != 0.0 and side_of(p, sine, cosine, w_end, gravity) != side
            if crosses:
                shorter = time_to_event(motor, v, sense, side, angle, h, stribeck, gravity, at, False)
                stops, last = stops and shorter >= h, last and shorter >= h
                h = shorter
                angle_end, w_end = stages(motor, v, sense, side, angle, h, stribeck, gravity, at)
                sine, cosine = of_angle(angle_end, gravity)
            if count:
                differentiate(motor, sense, side, at, by, stribeck, gravity)
                carry(x, by, h)
            if crosses:
                side = -side
            now = until if last and not stops else now + h
            angle, w = angle_end, w_end
            if stops:
                f = slope(motor, v, sense, side, sine, cosine, 0.0, stribeck, gravity)[0]
                w = 0.0
                sense = sense_of(p, v, angle, w, friction, gravity)
                after = 0.0
                if sense != 0.0:
                    after = slope(motor, v, sense, side, sine, cosine, w, stribeck, gravity)[0]
                left = after / f if f != 0.0 else 0.0
                for c in range(x.shape[1]):
                    x[1, c] *= left
        now = until
        sine, cosine = of_angle(angle, gravity)  # afresh, so that rounding doesn't add up
        if changes:
            f = after = 0.0
            if sense != 0.0:
                f = slope(motor, v, sense, side, sine, cosine, w, stribeck, gravity)[0]
            v = u[k]
            k += 1
            if w == 0.0:
                sense = sense_of(p, v, angle, w, friction, gravity)
            if sense != 0.0:
                after = slope(motor, v, sense, side, sine, cosine, w, stribeck, gravity)[0]
            x[1, DELAY] += f - after

"""Compiled kernels of an ensemble: the motors' coefficients in closed form, sixteen motors side by side, and loops around them.

The model is that of `servobench.rig.motor.physics`, the step is that of its solver `exact` without the cut at a switch: exact
zero-order hold, friction as the implicit step d = clip(ω_free, ±c₁) (Moreau 1988). A tick in which the shaft stops or turns back
is exact to first order only.

A random torque is held over a tick: a normal number for each motor and tick, by SplitMix64 (Steele, Lea and Flood 2014) of the
motor's `key` and the tick's number, so that it depends on neither the threads nor the order; and by Box and Muller (1958).

`c` (ROWS, M) are the coefficients of M motors, laid out below; `states` (3, K, M) get current, speed and angle after the ticks
`looks` (K,), which rise; `counts` (M/16, N, 16) the encoder's counts at the beginning of each tick, in 16 bits. The blocks of 16
motors from `first` to before `last` are done. Everything is in SI units.

What is kept on disk of the compiled code is renewed by a change of this file, not of `lanes` or the control laws that it calls:
after one of those delete `__pycache__`.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled, loosely_compiled
from servobench.rig.ensemble.lanes import LANES, lanes
from servobench.systems.control import kernels as laws

Keys: TypeAlias = NDArray[np.uint64]

A00, A01, B0, A10, A11, B1, T0, T1, TB, C1, G, Q, LIMIT, SCALE, SHOCK = range(15)
ROWS = 15
# Rows of the physical parameters that `hold` makes them of.
R, L, K, J, B, TC = range(6)

PID, LEAD, STATE_FEEDBACK = 1, 2, 3
"""The laws that `loops` knows, by their numbers."""
# What `loops` reads off a response: its peak as a part of the step, and when it last left the band around the end.
PEAK, SETTLED = 0, 1
# Numbers of the loop around a motor.
TICK, LARGEST, SLEW, DEAD_BAND, HALF_RANGE, BEGUN, STEP_AT, INITIAL, FINAL, BAND, FOLLOWS_SPEED = range(11)

_NEAR = 1e-3  # roots nearer than that share of their size lose digits in their difference
_SHORT = 1e-2  # of a root's time; below it a difference of exponentials is a series
_GOLD = np.uint64(0x9E3779B97F4A7C15)
_FIRST, _SECOND = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_TO_UNIT = 2.0**-53


@compiled
def mix(z: np.uint64) -> np.uint64:
    """Return 64 bits that have nothing to do with the 64 bits given: the finaliser of SplitMix64."""
    z = (z ^ (z >> np.uint64(30))) * _FIRST
    z = (z ^ (z >> np.uint64(27))) * _SECOND
    return z ^ (z >> np.uint64(31))


@compiled
def normal_pair(key: np.uint64, pair: int) -> tuple[float, float]:
    """Return the standard normal numbers of two ticks, 2 `pair` and the one after it."""
    one = mix(key + np.uint64(2 * pair + 1) * _GOLD)
    other = mix(key + np.uint64(2 * pair + 2) * _GOLD)
    radius = math.sqrt(-2.0 * math.log((np.float64(one >> np.uint64(11)) + 1.0) * _TO_UNIT))
    angle = 2.0 * math.pi * np.float64(other >> np.uint64(11)) * _TO_UNIT
    return radius * math.cos(angle), radius * math.sin(angle)


@compiled
def keys_of(seed: np.uint64, keys: Keys) -> None:
    """Fill the key of each motor (M,), 64 bits, for a seed of 64 bits."""
    for m in range(len(keys)):
        keys[m] = mix(mix(seed) + (np.uint64(m) + np.uint64(1)) * _GOLD)


@compiled
def second_integral(x: float, h: float) -> float:
    """Return ∫₀ʰ (e^(x s/h) - 1) h/x ds = h² (e^x - 1 - x)/x²."""
    if abs(x) < _SHORT:
        return h * h * (0.5 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x / 5040)))))
    return h * h * (math.expm1(x) - x) / (x * x)


@compiled
def hold(physics: Array, h: float, noise: float, c: Array, unsolved: Array) -> None:
    """Fill the coefficients `c` of motors from their `physics` (6, M) for a tick h; `noise` is a torque's intensity [N·m/√Hz].

    With the roots l₁, l₂ of the sliding motor's matrix A, F = (f(l₁)(A - l₂) - f(l₂)(A - l₁))/(l₁ - l₂) is e^(Ah) for f = e^(lh),
    its integral for f = (e^(lh) - 1)/l, and that one's for f = (e^(lh) - 1 - lh)/l² (Sylvester 1883). Where the roots are complex
    or too near to each other for that, `unsolved` (M,) is set and nothing filled in.
    """
    for n in range(physics.shape[1]):
        r, l, k, j, b, tc = (
            physics[R, n],
            physics[L, n],
            physics[K, n],
            physics[J, n],
            physics[B, n],
            physics[TC, n],
        )
        unsolved[n] = 0.0
        if l == 0.0:
            x = -(b + k * k / r) / j * h
            e, integral, second = math.exp(x), h * math.expm1(x) / x, second_integral(x, h)
            per_volt = k / (r * j)
            c[A00, n], c[A01, n], c[B0, n] = 0.0, -k / r * e, (1.0 - k * integral * per_volt) / r
            c[A10, n], c[A11, n], c[B1, n] = 0.0, e, integral * per_volt
            c[T0, n], c[T1, n], c[TB, n] = 0.0, integral, second * per_volt
            c[C1, n], c[G, n], c[Q, n] = integral / j * tc, k / r, second / integral
            c[SHOCK, n] = integral / j * noise / math.sqrt(h)
            continue
        a00, a01, a10, a11 = -r / l, -k / l, k / j, -b / j
        middle, det = 0.5 * (a00 + a11), a00 * a11 - a01 * a10
        square = middle * middle - det
        if not square > (_NEAR * middle) ** 2:
            unsolved[n] = 1.0
            continue
        fast = middle - math.sqrt(square)
        slow = det / fast
        apart = slow - fast
        e1, e2 = math.exp(h * slow), math.exp(h * fast)
        g1, g2 = math.expm1(h * slow) / slow, math.expm1(h * fast) / fast
        q1, q2 = second_integral(h * slow, h), second_integral(h * fast, h)
        c[A00, n] = (e1 * (a00 - fast) - e2 * (a00 - slow)) / apart
        c[A01, n], c[A10, n] = a01 * (e1 - e2) / apart, a10 * (e1 - e2) / apart
        c[A11, n] = (e1 * (a11 - fast) - e2 * (a11 - slow)) / apart
        c[B0, n] = (g1 * (a00 - fast) - g2 * (a00 - slow)) / apart / l
        c[T0, n] = a10 * (g1 - g2) / apart
        c[T1, n] = (g1 * (a11 - fast) - g2 * (a11 - slow)) / apart
        c[B1, n], c[TB, n] = c[T0, n] / l, a10 * (q1 - q2) / apart / l
        c[C1, n] = c[T1, n] / j * tc
        c[G, n] = -a01 * (g1 - g2) / apart / c[T1, n]
        c[Q, n] = (q1 * (a11 - fast) - q2 * (a11 - slow)) / apart / c[T1, n]
        c[SHOCK, n] = c[T1, n] / j * noise / math.sqrt(h)


@loosely_compiled
def drive(
    c: Array,
    voltages: Array,
    looks: Array,
    states: Array,
    counts: Array | None,
    keys: Keys | None,
    angle: float,
    first: int,
    last: int,
) -> None:
    """Drive motors that rest at an angle with the same voltages (N,), each within ±its own LIMIT; with `keys` (M,) at random.

    Every value has to be finite, and every count within 32 bits: that is for the caller to see to.
    """
    a00, a01, b0, a10, a11, b1 = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    t0, t1, tb, c1, g, q = lanes(), lanes(), lanes(), lanes(), lanes(), lanes()
    limit, scale, current, speed, theta = lanes(), lanes(), lanes(), lanes(), lanes()
    shocks, later = lanes(), lanes()
    for block in range(first, last):
        start = block * LANES
        for j in range(LANES):
            m = start + j
            a00[j], a01[j], b0[j] = c[A00, m], c[A01, m], c[B0, m]
            a10[j], a11[j], b1[j] = c[A10, m], c[A11, m], c[B1, m]
            t0[j], t1[j], tb[j] = c[T0, m], c[T1, m], c[TB, m]
            c1[j], g[j], q[j] = c[C1, m], c[G, m], c[Q, m]
            limit[j], scale[j] = c[LIMIT, m], c[SCALE, m]
            current[j], speed[j], theta[j] = 0.0, 0.0, angle
        begun = 0
        for look in range(len(looks)):
            for tick in range(begun, looks[look]):
                u = voltages[tick]
                if keys is not None:
                    for j in range(LANES):
                        if tick & 1:
                            shocks[j] = later[j]
                        else:
                            one, other = normal_pair(keys[start + j], tick // 2)
                            shocks[j], later[j] = c[SHOCK, start + j] * one, c[SHOCK, start + j] * other
                for j in range(LANES):
                    if counts is not None:
                        counts[block, tick, j] = np.int16(np.int32(math.floor(theta[j] * scale[j])))
                    i, w = current[j], speed[j]
                    v = max(-limit[j], min(limit[j], u))
                    free = a10[j] * i + a11[j] * w + b1[j] * v
                    if keys is not None:
                        free += shocks[j]
                    d = max(-c1[j], min(c1[j], free))
                    speed[j] = free - d
                    if keys is not None:
                        d -= shocks[j]
                    theta[j] += (t0[j] * i + tb[j] * v) + (t1[j] * w - q[j] * d)
                    current[j] = a00[j] * i + a01[j] * w + b0[j] * v + g[j] * d
            begun = looks[look]
            for j in range(LANES):
                m = start + j
                states[0, look, m], states[1, look, m], states[2, look, m] = current[j], speed[j], theta[j]


@compiled
def loops(
    c: Array,
    p: Array,
    law: int,
    x0: Array,
    gains: Array,
    references: Array,
    looks: Array,
    states: Array,
    counts: Array | None,
    voltages: Array | None,
    keys: Keys | None,
    figures: Array,
    angle: float,
    first: int,
    last: int,
) -> None:
    """Let a control law drive each motor, which rests at an angle, with the references (N,).

    `x0` and `gains` are the law's state and numbers (`servobench.systems.control.kernels`), `p` (11,) those of the loop around
    it. `voltages` (M, N) get what is applied; `figures` (2, M) peak and settling time where the reference is a step.
    """
    half = int(p[HALF_RANGE])
    own = gains.copy()
    for m in range(first * LANES, last * LANES):
        i, w, theta, applied, x = 0.0, 0.0, angle, p[BEGUN], x0.copy()
        peak, settled, look, next_shock = -math.inf, 0.0, 0, 0.0
        own[laws.LOWEST], own[laws.HIGHEST] = (
            max(gains[laws.LOWEST], -c[LIMIT, m]),
            min(gains[laws.HIGHEST], c[LIMIT, m]),
        )
        for tick in range(looks[-1]):
            shown = math.floor(theta * c[SCALE, m])
            if counts is not None:
                counts[m // LANES, tick, m % LANES] = np.int16(shown)
            shown = (shown + half) % (2 * half) - half
            now = tick * p[TICK]
            if law == PID:
                x, wanted = laws.pid(x, own, references[tick], shown, now)
            elif law == LEAD:
                x, wanted = laws.lead(x, own, references[tick], shown, now)
            else:
                x, wanted = laws.state_feedback(x, own, references[tick], shown, now)
            wanted = max(-p[LARGEST], min(p[LARGEST], wanted))
            most = p[SLEW] * p[TICK]
            wanted = max(applied - most, min(applied + most, wanted))
            applied = max(-c[LIMIT, m], min(c[LIMIT, m], wanted))
            if voltages is not None:
                voltages[m, tick] = applied
            v = applied - max(-p[DEAD_BAND], min(p[DEAD_BAND], applied))
            shock, next_shock = next_shock, 0.0
            if keys is not None and tick & 1 == 0:
                one, other = normal_pair(keys[m], tick // 2)
                shock, next_shock = c[SHOCK, m] * one, c[SHOCK, m] * other
            free = c[A10, m] * i + c[A11, m] * w + c[B1, m] * v + shock
            d = max(-c[C1, m], min(c[C1, m], free))
            net = d - shock
            theta += (c[T0, m] * i + c[TB, m] * v) + (c[T1, m] * w - c[Q, m] * net)
            i = c[A00, m] * i + c[A01, m] * w + c[B0, m] * v + c[G, m] * net
            w = free - d
            reached = ((w if p[FOLLOWS_SPEED] != 0.0 else theta) - p[INITIAL]) / (p[FINAL] - p[INITIAL])
            after = (tick + 1) * p[TICK] - p[STEP_AT]
            if after > 0.0:
                peak = max(peak, reached)
                if abs(reached - 1.0) > p[BAND]:
                    settled = after
            if tick + 1 == looks[look]:
                states[0, look, m], states[1, look, m], states[2, look, m] = i, w, theta
                look += 1
        figures[PEAK, m], figures[SETTLED, m] = peak, settled

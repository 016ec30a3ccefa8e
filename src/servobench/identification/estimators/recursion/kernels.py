"""Compiled kernels of the recursive estimator: a first-order motor sample by sample, and Kalman filters for many noise levels.

The motor and its sensitivities go from event to event, as in `models.kernels`; docs/decisions/0022-recursive.md says why sums
are kept. Each sample gives a row [J r], r = y - prediction; rows are averaged over blocks of a few lengths, and each filter
turns the means into innovations and adds up their products.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.identification.models.kernels import (
    ANGLE,
    COLUMNS,
    END,
    EXTRA,
    RATE,
    RESPONSE,
    TAU,
    advance_piece,
    drive_piece,
    weights,
)

Whole = NDArray[np.int64]

# What stands where in the state of the motor: the beginning of the piece under way, the input that acts, and whether it rests.
NOW, HELD, RESTS = 0, 1, 2
# What stands where in the state of a block: samples so far, the sum of their times, whether the shaft slides, the time of the
# mean before (NaN where there is none), the number of means so far, and whether the shaft rested in the block before.
SAMPLES, TIMES, SLIDES, BEFORE, MEANS, RESTED = 0, 1, 2, 3, 4, 5
WIDTH = COLUMNS + 1


@compiled
def advance(
    t: float, x: Array, motor: Array, p: Array, friction: float, t_in: Array, u: Array, first: int, row: Array
) -> tuple[int, float]:
    """Move the motor to a sample at t and fill row (8,) with the derivatives and the position there.

    Inputs u (N,) that hold from t_in (N,) act in turn from `first` on; x (4, 8) is the piece under way, `motor` (3,) its
    beginning and the input that acts. Returns the first input that hasn't acted yet, and the speed. A sample is latched before
    an input of the same instant acts.
    """
    k = first
    while True:
        while k < len(u) and u[k] == motor[HELD]:
            k += 1
        until = t
        if k < len(u):
            until = min(max(t_in[k] + p[4], motor[NOW]), t)
        until, stops = drive_piece(x, p, motor[HELD], friction, motor[NOW], until)
        if until >= t:
            break
        following = motor[HELD] if stops else u[k]
        h = until - motor[NOW]
        advance_piece(x, p, motor[HELD], following, friction, h, -math.expm1(-h / p[TAU]), stops)
        if not stops:
            k += 1
        motor[NOW], motor[HELD] = until, following
    h = t - motor[NOW]
    a = math.exp(-h / p[1])
    f0, f1, f2, f3 = weights(a, h, p[1], 0.0)
    for c in range(WIDTH):
        row[c] = f0 * x[ANGLE, c] + f1 * x[RATE, c] + f2 * x[END, c] + f3 * x[EXTRA, c]
    return k, a * x[RATE, RESPONSE] + (1.0 - a) * x[END, RESPONSE]


@compiled
def close_block(
    block: Array,
    total: Array,
    tau: float,
    rest: float,
    ratio: Array,
    p: Array,
    angle: Array,
    speed: Array,
    products: Array,
    logarithms: Array,
    shown: int,
    out: Array,
) -> bool:
    """Give the mean of a block to its filters, and begin the next one; returns whether it said anything.

    `total` (8,) is the sum of its rows; the F filters have the q/r `ratio` (F,), covariances p (F, 3), states `angle` and `speed`
    (F, 8), and sums of `products` (F, 8, 8) and `logarithms` (F,). The innovation of the filter `shown` goes to `out` (8,).
    While the shaft rests its encoder's rounding is one error, of variance `rest`, however many samples there are.
    """
    n = block[SAMPLES]
    time, slides = block[TIMES] / n, block[SLIDES]
    noise = 1.0 / n if slides != 0.0 else rest
    again = slides == 0.0 and block[RESTED] != 0.0
    block[RESTED] = 1.0 - slides
    h = time - block[BEFORE]
    z = h / tau
    b = -math.expm1(-z)
    a, g = 1.0 - b, tau * b
    q22 = -0.5 * tau * math.expm1(-2.0 * z)
    q12 = 0.5 * g * g
    q11 = (
        h * h * h * (1 / 3 - z / 4 + 7 * z * z / 60 - z * z * z / 24)
        if z < 1e-3
        else tau * tau * (h - 2 * g + q22)
    )
    e = np.empty(WIDTH)
    for f in range(len(ratio)):
        p11, p12, p22 = p[f, 0], p[f, 1], p[f, 2]
        if not math.isnan(block[BEFORE]):
            if slides == 0.0:
                p12 = p22 = 0.0
                for c in range(WIDTH):
                    speed[f, c] = 0.0
            else:
                p11 += 2.0 * g * p12 + g * g * p22 + ratio[f] * q11
                p12 = a * (p12 + g * p22) + ratio[f] * q12
                p22 = a * a * p22 + ratio[f] * q22
                for c in range(WIDTH):
                    angle[f, c] += g * speed[f, c]
                    speed[f, c] *= a
        if again:
            p[f, 0], p[f, 1], p[f, 2] = p11, p12, p22
            continue
        s = p11 + noise
        g1, g2, scale = p11 / s, p12 / s, 1.0 / math.sqrt(s)
        for c in range(WIDTH):
            e[c] = total[c] / n - angle[f, c]
            angle[f, c] += g1 * e[c]
            speed[f, c] += g2 * e[c]
            e[c] *= scale
        p[f, 0], p[f, 1], p[f, 2] = p11 - g1 * p11, p12 - g1 * p12, p22 - g2 * p12
        logarithms[f] += math.log(s)
        for i in range(WIDTH):
            for c in range(i, WIDTH):
                products[f, i, c] += e[i] * e[c]
        if f == shown:
            out[:] = e
    block[SAMPLES], block[TIMES] = 0.0, 0.0
    block[BEFORE] = time
    total[:] = 0.0
    if again:
        return False
    block[MEANS] += 1.0
    return True


@compiled
def add_rounding(row: Array, place: float, weight: float, sines: Array) -> None:
    """Add what the sines of an encoder's rounding make of the score of a sample with derivatives row (8,), before their sizes.

    `sines` (2 M, 7) has cosine and sine of m = 1 ... M periods in a step in turns; `place` is the shaft's, in steps.
    """
    once_c, once_s = math.cos(2 * math.pi * place), math.sin(2 * math.pi * place)
    turned_c, turned_s = 1.0, 0.0
    for m in range(len(sines) // 2):
        turned_c, turned_s = turned_c * once_c - turned_s * once_s, turned_c * once_s + turned_s * once_c
        for c in range(COLUMNS):
            sines[2 * m, c] += weight * turned_c * row[c]
            sines[2 * m + 1, c] += weight * turned_s * row[c]


@compiled
def stream(
    t: Array,
    y: Array,
    t_in: Array,
    u: Array,
    x: Array,
    motor: Array,
    reference: Array,
    friction: float,
    gap: float,
    rest: float,
    sizes: Whole,
    filters: Whole,
    blocks: Array,
    totals: Array,
    ratio: Array,
    p: Array,
    angle: Array,
    speed: Array,
    products: Array,
    logarithms: Array,
    quantum: float,
    sines: Array,
    senses: Array,
    shown: int,
    change: Array,
    residual: Array,
    innovations: Array,
) -> tuple[int, int]:
    """Take samples y (M,) at t (M,) and inputs u (N,) that hold from t_in (N,); everything else is the state, changed in place.

    Blocks of `sizes` (B,) samples have the filters from filters[b] to filters[b + 1] - 1 each. `residual` (M,) gets
    y - prediction, and `innovations` (M, 8) those of the filter `shown`, both after a `change` (7,) of the reference for the
    former. `sines` (16, 7) gets what the rounding to steps of `quantum` (0: there is none) makes of the scores; a rest counts
    once. Returns how many inputs have acted, and how many innovations there are.
    """
    row, one = np.empty(WIDTH), np.empty(WIDTH)
    k, count = 0, 0
    before = t[0]
    for m in range(len(t)):
        k, w = advance(t[m], x, motor, reference, friction, t_in, u, k, row)
        row[RESPONSE] = y[m] - row[RESPONSE]
        left = row[RESPONSE]
        for c in range(COLUMNS):
            left -= row[c] * change[c]
        residual[m] = left
        slides = 1.0 if w != 0.0 or friction == 0.0 else 0.0
        if quantum > 0.0 and (slides == 1.0 or motor[RESTS] != 1.0):
            add_rounding(row, (y[m] - left) / quantum, 1.0 if slides == 1.0 else 1.0 / rest, sines)
        motor[RESTS] = 1.0 - slides
        senses[0 if w > 0.0 else (1 if w < 0.0 else 2)] += 1.0
        for b in range(len(sizes)):
            first, last = filters[b], filters[b + 1]
            here = shown - first if first <= shown < last else -1
            open_block = blocks[b, SAMPLES] > 0
            if open_block and (blocks[b, SLIDES] != slides or t[m] - before > gap):
                complete = close_block(
                    blocks[b], totals[b], reference[1], rest, ratio[first:last], p[first:last], angle[first:last],
                    speed[first:last], products[first:last], logarithms[first:last], here, one,
                )  # fmt: skip
                if here >= 0 and complete:
                    innovations[count] = one
                    count += 1
            blocks[b, SAMPLES] += 1.0
            blocks[b, TIMES] += t[m]
            blocks[b, SLIDES] = slides
            for c in range(WIDTH):
                totals[b, c] += row[c]
            if blocks[b, SAMPLES] >= sizes[b]:
                complete = close_block(
                    blocks[b], totals[b], reference[1], rest, ratio[first:last], p[first:last], angle[first:last],
                    speed[first:last], products[first:last], logarithms[first:last], here, one,
                )  # fmt: skip
                if here >= 0 and complete:
                    innovations[count] = one
                    count += 1
        before = t[m]
    return k, count

"""Compiled simulators: linear plants exactly, Coulomb friction from event to event, the rest in short steps.

All of them latch sample k before the input u[k] acts.
"""

import math

import numba
import numpy as np


@numba.njit(cache=True)
def linear(a1, b1, a2, b2, late, held, x, kicks, out):
    """Fill out (N, S) with the states of a linear plant: `late[k]` acts first in tick k (a1, b1), then `held[k]` (a2, b2).

    `kicks` (N, S), or (0, S) for none, is added at the end of each tick.
    """
    for n in range(len(late)):
        out[n] = x
        x = a1 @ x + b1 * late[n]
        x = a2 @ x + b2 * held[n]
        if len(kicks):
            x = x + kicks[n]


@numba.njit(cache=True)
def _slide(p, e, h, w, theta):
    """Return speed and angle after a time h with a voltage e; p = (K, τ, Coulomb voltage). Stops are met exactly."""
    gain, tau, lost = p
    while h > 0.0:
        if w == 0.0 and abs(e) <= lost:
            return w, theta
        sense = math.copysign(1.0, e if w == 0.0 else w)
        end = gain * (e - sense * lost)
        span, stops = h, False
        if w * end < 0.0:
            # 0 = end + (w - end) e^(-s/τ)
            until = tau * math.log((end - w) / end)
            stops = until < h
            span = min(until, h)
        change = -math.expm1(-span / tau) * (end - w)
        # τ (ω₁ - ω₀) + (θ₁ - θ₀) = end · s
        theta += end * span - tau * change
        w = 0.0 if stops else w + change
        h -= span
    return w, theta


@numba.njit(cache=True)
def coulomb(p, late, held, first, dt, start, out):
    """Fill out (N, 2) with speed and angle of a first-order motor with Coulomb friction, exactly.

    In each tick of length dt `late[k]` acts for the time `first`, then `held[k]`; p = (K, τ, Coulomb voltage).
    """
    w, theta = start
    for n in range(len(late)):
        out[n, 0], out[n, 1] = w, theta
        w, theta = _slide(p, late[n], first, w, theta)
        w, theta = _slide(p, held[n], dt - first, w, theta)


@numba.njit(cache=True)
def _slopes(p, r, u, sense, i, w, theta):
    """di/dt and dω/dt of a motor that slides in a sense; without inductance the current has no slope."""
    l, k, j, b, tc, excess, stribeck, ripple, cycles, phase = p
    friction = sense * tc * (1.0 + excess * math.exp(-((w / stribeck) ** 2)))
    if l == 0.0:
        current, di = (u - k * w) / r, 0.0
    else:
        current, di = i, (u - r * i - k * w) / l
    torque = k * current - b * w - friction - ripple * math.sin(cycles * theta + phase)
    return di, torque / j


@numba.njit(cache=True)
def march(p, u, resistance, dt, substeps, start, out):
    """Fill out (N, 2) with speed and angle of one inertia with friction, ripple and a resistance (N,) that changes.

    p = (L, k, J, b, Coulomb torque, static excess over it, Stribeck speed, ripple torque, its cycles a turn, its phase).
    The midpoint rule, second order; a step in which the speed would change sign ends at the change.
    """
    l, k, tc, excess, ripple, cycles, phase = p[0], p[1], p[4], p[5], p[7], p[8], p[9]
    i, w, theta = start
    for n in range(len(u)):
        out[n, 0], out[n, 1] = w, theta
        r = resistance[n]
        for _step in range(substeps):
            h = dt / substeps
            for _part in range(10):
                if w == 0.0:
                    current = i if l > 0.0 else u[n] / r
                    pull = k * current - ripple * math.sin(cycles * theta + phase)
                    if abs(pull) <= tc * (1.0 + excess):
                        if l > 0.0:
                            i = u[n] / r + (i - u[n] / r) * math.exp(-h * r / l)
                        break
                    sense = math.copysign(1.0, pull)
                else:
                    sense = math.copysign(1.0, w)
                di, dw = _slopes(p, r, u[n], sense, i, w, theta)
                middle = w + 0.5 * h * dw
                di, dw = _slopes(p, r, u[n], sense, i + 0.5 * h * di, middle, theta + 0.5 * h * w)
                w_new = w + h * dw
                if w_new * sense < 0.0 and w != 0.0:
                    part = w / (w - w_new)
                    i += part * h * di
                    theta += 0.5 * part * h * w
                    w = 0.0
                    h *= 1.0 - part
                    continue
                i += h * di
                theta += h * middle
                w = w_new
                break


@numba.njit(cache=True)
def backlash(p, u, dt, substeps, start, out):
    """Fill out (N, 4) with speeds and angles of motor and load (ω, θ, ω_l, θ_l) that meet across a gap.

    p = (R, k, J, b, Coulomb torque, J_l, b_l, half gap, stiffness, damping): beyond half a gap a spring and a damper push,
    and never pull. Leapfrog: half a step of the angles, a step of the speeds with losses implicit, half a step of the angles;
    second order.
    """
    r, k, j, b, tc, j_l, b_l, half, stiffness, damping = p
    w, theta, w_l, theta_l = start
    h = dt / substeps
    loss, loss_l = 0.5 * h * (b + k * k / r) / j, 0.5 * h * b_l / j_l
    for n in range(len(u)):
        out[n, 0], out[n, 1], out[n, 2], out[n, 3] = w, theta, w_l, theta_l
        for _step in range(substeps):
            theta += 0.5 * h * w
            theta_l += 0.5 * h * w_l
            twist = theta - theta_l
            push = 0.0
            if twist > half:
                push = max(stiffness * (twist - half) + damping * (w - w_l), 0.0)
            elif twist < -half:
                push = min(stiffness * (twist + half) + damping * (w - w_l), 0.0)
            free = (w * (1.0 - loss) + h * (k * u[n] / r - push) / j) / (1.0 + loss)
            stop = h * tc / j
            w = free - min(stop, max(-stop, free))
            w_l = (w_l * (1.0 - loss_l) + h * push / j_l) / (1.0 + loss_l)
            theta += 0.5 * h * w
            theta_l += 0.5 * h * w_l


@numba.njit(cache=True)
def innovate(a, noise, r, x):
    """Turn columns x (N, C) of the position into innovations over √S of a filter that knows the start state.

    a (2, 2) is the transition of (θ, ω), noise (2, 2) the covariance that each tick adds, r the variance of the measurement.
    """
    columns = x.shape[1]
    state = np.zeros((columns, 2))
    p11, p12, p22 = 0.0, 0.0, 0.0
    for n in range(len(x)):
        s = p11 + r
        g1, g2 = p11 / s, p12 / s
        for c in range(columns):
            e = x[n, c] - state[c, 0]
            th, w = state[c, 0] + g1 * e, state[c, 1] + g2 * e
            state[c, 0] = a[0, 0] * th + a[0, 1] * w
            state[c, 1] = a[1, 0] * th + a[1, 1] * w
            x[n, c] = e / math.sqrt(s)
        q11, q12, q22 = p11 - g1 * p11, p12 - g1 * p12, p22 - g2 * p12
        m11, m12 = a[0, 0] * q11 + a[0, 1] * q12, a[0, 0] * q12 + a[0, 1] * q22
        m21, m22 = a[1, 0] * q11 + a[1, 1] * q12, a[1, 0] * q12 + a[1, 1] * q22
        p11 = m11 * a[0, 0] + m12 * a[0, 1] + noise[0, 0]
        p12 = m11 * a[1, 0] + m12 * a[1, 1] + noise[0, 1]
        p22 = m21 * a[1, 0] + m22 * a[1, 1] + noise[1, 1]

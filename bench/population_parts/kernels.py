"""Compiled simulators of one motor: exactly from event to event, or in short steps where the motor departs from its model.

    τ dω/dt = -ω + K (v - u_c sgn ω),   dθ/dt = ω

Events are the changes of the voltage v that acts; a sample is latched before an event of the same instant. Times are in s,
voltages in V, angles in rad.
"""

import math

import numba
import numpy as np


@numba.njit(cache=True)
def advance(p, v, h, w, theta):
    """Return speed and angle after a time h at a voltage v; p = (K, τ, u_c). Where the shaft stops is met exactly."""
    gain, tau, coulomb = p
    while h > 0.0:
        if w == 0.0 and abs(v) <= coulomb:
            return 0.0, theta
        sense = math.copysign(1.0, v if w == 0.0 else w)
        end = gain * (v - sense * coulomb)
        piece, stops = h, False
        if coulomb > 0.0 and w * end < 0.0:
            # end + (w - end) e^(-s/τ) = 0
            stop = tau * math.log1p(-w / end)
            if stop < h:
                piece, stops = stop, True
        gone = -math.expm1(-piece / tau)
        # The speed covers (end - w) gone; what it lacks of `end` on the way is τ (w - end) gone of angle.
        theta += end * piece + tau * (w - end) * gone
        w = 0.0 if stops else w + (end - w) * gone
        h -= piece
    return w, theta


@numba.njit(cache=True)
def turn(p, times, volts, before, latches, start, out):
    """Fill out (M, 2) with speed and angle at times `latches` (M,), from `start` (ω, θ) at the first of them on.

    The voltage is `before` until times[0], then volts[k] from times[k] (E,) on; events before the first latch are past.
    """
    w, theta = start
    now, v = latches[0], before
    k = 0
    while k < len(times) and times[k] < now:
        v = volts[k]
        k += 1
    for m in range(len(latches)):
        while k < len(times) and times[k] < latches[m]:
            w, theta = advance(p, v, times[k] - now, w, theta)
            now, v = times[k], volts[k]
            k += 1
        w, theta = advance(p, v, latches[m] - now, w, theta)
        now = latches[m]
        out[m, 0], out[m, 1] = w, theta


@numba.njit(cache=True)
def lagged(u, decay, before):
    """Return an input (N,) behind a lag that keeps `decay` of its distance in a step, at the middle of each step."""
    out = np.empty(len(u))
    x, half = before, math.sqrt(decay)
    for n in range(len(u)):
        out[n] = u[n] + (x - u[n]) * half
        x = u[n] + (x - u[n]) * decay
    return out


@numba.njit(cache=True)
def _pull(q, v, i, w, theta, ahead):
    """The torque beside friction, as a voltage: current i (volts at the resistance at rest of a cold motor) less cogging.

    Cogging is averaged over the way that is `ahead`, so that teeth that pass within a step weigh nothing.
    """
    cog, teeth, phase = q[5], q[6], q[7]
    if cog == 0.0:
        return i
    half = 0.5 * teeth * ahead
    mean = 1.0 if abs(half) < 1e-9 else math.sin(half) / half
    return i - cog * mean * math.sin(teeth * theta + phase + half)


@numba.njit(cache=True)
def _slopes(q, r, v, i, sense, w, theta, h):
    """Return the slopes of current and speed of a shaft that slides in a sense; without a winding the current has none."""
    gain, tau, coulomb, excess, slow, winding = q[0], q[1], q[2], q[3], q[4], q[8]
    static = (v - w / gain) / r
    di = 0.0
    if winding == 0.0:
        i = static
    else:
        di = (static - i) / winding
    friction = sense * coulomb * (1.0 + excess * math.exp(-((w / slow) ** 2)))
    return di, gain * (_pull(q, v, i, w, theta, w * h) - friction) / tau


@numba.njit(cache=True)
def _settled(q, r, v, h, state):
    """Whether the shaft sticks over a step h; then the current alone goes on."""
    i, w, theta = state[0], state[1], state[2]
    if w != 0.0:
        return False
    static, winding = v / r, q[8]
    now = static if winding == 0.0 else i
    if abs(_pull(q, v, now, 0.0, theta, 0.0)) > q[2] * (1.0 + q[3]):
        return False
    state[0] = static if winding == 0.0 else static + (i - static) * math.exp(-h / winding)
    return True


@numba.njit(cache=True)
def _stepped(q, r, v, h, state):
    """Move a state (i, ω, θ) on by h, by the midpoint rule; a step in which the speed changes sign ends there and goes on."""
    for _part in range(8):
        if h <= 0.0 or _settled(q, r, v, h, state):
            return
        i, w, theta = state[0], state[1], state[2]
        current = (v - w / q[0]) / r if q[8] == 0.0 else i
        sense = math.copysign(1.0, w if w != 0.0 else _pull(q, v, current, w, theta, 0.0))
        di, dw = _slopes(q, r, v, i, sense, w, theta, h)
        middle = w + 0.5 * h * dw
        di, dw = _slopes(q, r, v, i + 0.5 * h * di, sense, middle, theta + 0.5 * h * w, h)
        after = w + h * dw
        if q[2] > 0.0 and w != 0.0 and after * sense < 0.0:
            part = w / (w - after)
            state[0], state[1], state[2] = i + part * h * di, 0.0, theta + 0.5 * part * h * w
            h *= 1.0 - part
            continue
        state[0], state[1], state[2] = i + h * di, after, theta + h * middle
        return


@numba.njit(cache=True)
def march(q, times, volts, before, latches, start, step, out):
    """As `turn`, in steps of at most `step`, for a motor with departures.

    q = (K, τ, u_c, static excess, Stribeck speed, cogging voltage, teeth, phase, winding L/R, sag, its voltage, warming,
    its time):
    the resistance is 1 + sag (v/voltage)² + warming (t - t₀)/time of the cold one.
    """
    state = np.zeros(3)
    state[1], state[2] = start
    first = latches[0]
    now, v = first, before
    k = 0
    while k < len(times) and times[k] < now:
        v = volts[k]
        k += 1
    state[0] = v - state[1] / q[0]
    for m in range(len(latches)):
        while True:
            is_event = k < len(times) and times[k] < latches[m]
            until = times[k] if is_event else latches[m]
            count = math.ceil((until - now) / step)
            for _n in range(count):
                h = (until - now) / count
                r = 1.0 + q[9] * (v / q[10]) ** 2 + q[11] * (now - first) / q[12]
                _stepped(q, r, v, h, state)
            now = until
            if not is_event:
                break
            v = volts[k]
            k += 1
        out[m, 0], out[m, 1] = state[1], state[2]


@numba.njit(cache=True)
def whiten(transitions, noises, sliding, reads_speed, variances, x):
    """Turn columns x (N, C) into innovations over √S of a Kalman filter of (ω, θ) that knows the start state.

    `transitions` (N, 2, 2) and `noises` (2, 2) belong to ticks in which the shaft slides (`sliding` (N,)); one that sticks has
    no random motion, and its speed is zero. What is measured is the speed or the angle, with `variances` (N,).
    """
    at = 0 if reads_speed else 1
    columns = x.shape[1]
    state = np.zeros((columns, 2))
    cov = np.zeros((2, 2))
    gain = np.zeros(2)
    for n in range(len(x)):
        s = cov[at, at] + variances[n]
        gain[0], gain[1] = cov[0, at] / s, cov[1, at] / s
        for c in range(columns):
            e = x[n, c] - state[c, at]
            w, th = state[c, 0] + gain[0] * e, state[c, 1] + gain[1] * e
            x[n, c] = e / math.sqrt(s)
            if sliding[n]:
                state[c, 0] = transitions[n, 0, 0] * w + transitions[n, 0, 1] * th
                state[c, 1] = transitions[n, 1, 0] * w + transitions[n, 1, 1] * th
            else:
                state[c, 0], state[c, 1] = 0.0, th
        left = np.empty((2, 2))
        for a in range(2):
            for b in range(2):
                left[a, b] = cov[a, b] - gain[a] * cov[at, b]
        if sliding[n]:
            cov = transitions[n] @ left @ transitions[n].T + noises
        else:
            cov[:] = 0.0
            cov[1, 1] = left[1, 1]

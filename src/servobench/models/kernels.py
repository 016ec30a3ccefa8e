"""Compiled kernels of the first-order models: the exact response to a held input, with its sensitivities, in one pass.

    τ dω/dt = -ω + K (u(t - d) - u₀ - u_c sgn(ω)),   dθ/dt = ω

Between two events nothing switches, so state and sensitivities are known in closed form. Events are the samples of the
output, the changes of the delayed input, and the instants at which the shaft stops. At an instant that depends on a
parameter the slope of the speed jumps from f⁻ to f⁺, and the sensitivity of the speed with it: by (f⁻ - f⁺) times the
derivative of the instant. For the input that derivative is 1 (by d); for a stop it is -S/f⁻, so S is scaled by f⁺/f⁻.
The angle's slope, the speed, doesn't jump. (Sensitivities of switched systems: Rozenvasser 1967.)
"""

from __future__ import annotations

import math

import numpy as np

from servobench.channels import Array
from servobench.compiled import compiled

# Columns of the Jacobian, and of the parameter vector.
GAIN, TAU, OFFSET, COULOMB, DELAY, POSITION, SPEED = 0, 1, 2, 3, 4, 5, 6
COLUMNS = 7


@compiled
def drive(p: Array, v: float, w: float, friction: float) -> tuple[float, float, float]:
    """Return (sense, end speed, slope of the speed) for an input v: the sense of sliding is ±1, or 0 at rest."""
    e = v - p[OFFSET]
    if friction == 0.0:
        end = p[GAIN] * e
        return 0.0, end, (end - w) / p[TAU]
    # The shaft follows the torque, whose sign is that of K e.
    torque = p[GAIN] * e
    if w == 0.0:
        if abs(e) <= p[COULOMB]:
            return 0.0, 0.0, 0.0
        sense = math.copysign(1.0, torque)
    else:
        sense = math.copysign(1.0, w)
    end = torque - abs(p[GAIN]) * sense * p[COULOMB]
    return sense, end, (end - w) / p[TAU]


@compiled
def response(
    t_in: Array,
    u: Array,
    u_before: float,
    t_out: Array,
    p: Array,
    friction: float,
    speed_out: float,
    y: Array,
    jac: Array,
) -> None:
    """Fill y (M,) and jac (M, 7) with the response at t_out (M,) to inputs u (N,) that hold from t_in (N,).

    p (7,) is (K, τ, u₀, u_c, d, θ at t_out[0], ω at t_out[0]); friction and speed_out are 1 or 0: whether u_c acts, and whether
    the speed or the angle is wanted. A sample is latched before an input of the same instant acts.
    """
    tau, delay = p[TAU], p[DELAY]
    th, w = p[POSITION], p[SPEED]
    s_th = np.zeros(COLUMNS)
    s_w = np.zeros(COLUMNS)
    force = np.zeros(COLUMNS)
    s_th[POSITION] = 1.0
    s_w[SPEED] = 1.0
    now = t_out[0]
    v = u_before
    k = 0
    while k < len(u) and t_in[k] + delay < now:
        v = u[k]
        k += 1
    h_last, a, b = -1.0, 1.0, 0.0
    for m in range(len(t_out)):
        until = t_out[m]
        while True:
            # The next event: a change of the input before this sample, or the sample itself.
            while k < len(u) and u[k] == v and t_in[k] + delay < until:
                k += 1
            changes = k < len(u) and t_in[k] + delay < until
            left = (t_in[k] + delay if changes else until) - now
            while left > 0.0:
                sense, end, _ = drive(p, v, w, friction)
                if friction != 0.0 and sense == 0.0:
                    # A shaft that sticks forgets how it came to rest.
                    for c in range(COLUMNS):
                        s_w[c] = 0.0
                    break
                h = left
                stops = friction != 0.0 and w * end < 0.0
                if stops:
                    # w e^(-h/τ) + end (1 - e^(-h/τ)) = 0
                    h_stop = tau * math.log1p(-w / end)
                    stops = h_stop <= left
                    if stops:
                        h = h_stop
                if abs(h - h_last) > 1e-13 * tau:
                    b = -math.expm1(-h / tau)
                    a = 1.0 - b
                    h_last = h
                g = tau * b
                force[GAIN] = end / p[GAIN]
                force[OFFSET] = -p[GAIN]
                force[COULOMB] = -abs(p[GAIN]) * sense
                for c in range(COLUMNS):
                    s_th[c] += g * s_w[c] + (h - g) * force[c]
                    s_w[c] = a * s_w[c] + b * force[c]
                s_th[TAU] += (b - a * h / tau) * (w - end)
                s_w[TAU] += a * h / (tau * tau) * (w - end)
                th += g * w + (h - g) * end
                w = a * w + b * end
                left -= h
                if stops:
                    w = 0.0
                    _, _, slope = drive(p, v, w, friction)
                    ratio = slope * tau / end
                    for c in range(COLUMNS):
                        s_w[c] *= ratio
            if not changes:
                now = until
                break
            now = t_in[k] + delay
            _, _, slope_before = drive(p, v, w, friction)
            v = u[k]
            k += 1
            _, _, slope_after = drive(p, v, w, friction)
            s_w[DELAY] += slope_before - slope_after
        if speed_out != 0.0:
            y[m] = w
            for c in range(COLUMNS):
                jac[m, c] = s_w[c]
        else:
            y[m] = th
            for c in range(COLUMNS):
                jac[m, c] = s_th[c]

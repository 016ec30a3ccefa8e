"""Compiled kernel of the first-order motor: the exact derivative of its response by friction that is larger near rest.

    τ dω/dt = -ω + K (u(t - d) - u₀ - (u_c + s f(ω)) sgn(ω)),   f(ω) = max(0, 1 - |ω|/w)

by s at s = 0. Within a piece the speed is known, ω = ω_end + c₀ e^(-h/τ), so that the derivative S follows

    τ dS/dt = -S - |K| sgn(ω) (1 - ω/±w)   while |ω| < w

in closed form: it is a piece as in `models.kernels`, with S_end = -|K| (±1 - ω_end/w) and c = |K| τ (ω - ω_end)/w. A piece ends
where the speed passes w, too; there f is continuous and nothing jumps. At a stop S jumps as all sensitivities do
(Rozenvasser 1967).
"""

from __future__ import annotations

import math

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.identification.models.kernels import (
    DELAY,
    GAIN,
    SPEED,
    TAU,
    first_input,
    slip_state,
    slope,
    stop_time,
    weights,
)


@compiled
def by_excess_friction(
    t_in: Array,
    u: Array,
    u_before: float,
    t_out: Array,
    p: Array,
    width: float,
    speed_out: float,
    s: Array,
) -> None:
    """Fill s (M,) with the derivative of the angle, or of the speed where speed_out is 1, at t_out (M,) [s].

    Inputs u (N,) [V] hold from t_in (N,) [s]; p (7,) is (K, τ, u₀, u_c, d, θ, ω) as for `kernels.response`, `width` is w > 0.
    """
    tau, delay, now, last = p[TAU], p[DELAY], t_out[0], t_out[-1]
    w, angle, rate = p[SPEED], 0.0, 0.0
    k, v = first_input(t_in, u, u_before, delay, now)
    s[0] = 0.0
    m = 1
    while m < len(t_out):
        while k < len(u) and u[k] == v:
            k += 1
        until = min(t_in[k] + delay, last) if k < len(u) else last
        sense, end = slip_state(p, v, w, 1.0)
        if sense == 0.0:
            w = rate = 0.0
        until, stops = stop_time(w, end, tau, 1.0, now, until)
        until, passes, slow = passage(w, end, sense, width, tau, now, until)
        stops = stops and not passes
        held = curved = 0.0
        if slow and sense != 0.0:
            held = -abs(p[GAIN]) * (sense - end / width)
            curved = abs(p[GAIN]) * tau * (w - end) / width
        while m < len(t_out) and t_out[m] <= until:
            h = t_out[m] - now
            f0, f1, f2, f3 = weights(math.exp(-h / tau), h, tau, speed_out)
            s[m] = f0 * angle + f1 * rate + f2 * held + f3 * curved
            m += 1
        h = until - now
        a = math.exp(-h / tau)
        f0, f1, f2, f3 = weights(a, h, tau, 0.0)
        angle += f1 * rate + f2 * held + f3 * curved
        rate = a * rate + (1.0 - a) * held + a * h / tau**2 * curved
        if stops:
            w = 0.0
            rate *= slope(p, v, 0.0, 1.0) * tau / end
        elif passes:
            w = sense * width
        else:
            w = a * w + (1.0 - a) * end
            if m < len(t_out):
                v = u[k]
                k += 1
        now = until


@compiled
def passage(
    w: float, end: float, sense: float, width: float, tau: float, now: float, until: float
) -> tuple[float, bool, bool]:
    """Return when a piece ends [s], `until` or as the speed passes ±width; whether it does; and whether it is slower until then.

    The speed is w at `now` [s] and tends to `end` with the time constant tau [s]; all speeds are in position units a second.
    """
    speed, final = sense * w, sense * end
    slow = speed < width if speed != width else final < width
    if sense != 0.0 and (speed - width) * (final - width) < 0.0:
        at = now - tau * math.log((width - final) / (speed - final))
        if at < until:
            return at, True, slow
    return until, False, slow

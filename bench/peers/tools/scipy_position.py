"""SciPy's least squares on the simulated position, as somebody would write it who knows the motor's equations.

    ω⁺ = a ω + K (1 - a) v,   θ⁺ = θ + g ω + K (T - g) v,   a = exp(-T/τ),   g = τ (1 - a)

with v = u, or u less an offset, or u less friction with stops and reversals. No term stands for a delay, as there is none
in the data; one method has it all the same, to show what not knowing that costs.
"""

import math

import numpy as np
from record import QUANTUM, Answer, Array, Method, Record, interval
from scipy.optimize import least_squares
from scipy.signal import lfilter


def linear_position(p: Array, u: Array, sample_time: float) -> Array:
    """The position for p = (ln K, ln τ, θ₀, ω₀, u₀, d), with a delay 0 <= d < T."""
    gain, tau, delay = math.exp(p[0]), math.exp(p[1]), float(p[5])
    v, rest = u - p[4], sample_time - delay
    earlier = np.concatenate([v[:1], v[:-1]])
    a, e, h = math.exp(-sample_time / tau), math.exp(-rest / tau), -math.expm1(-delay / tau)
    g = tau * (1.0 - a)
    kick = gain * (h * e * earlier + (1.0 - e) * v)
    way = gain * ((delay - tau * h + tau * h * (1.0 - e)) * earlier + (rest - tau * (1.0 - e)) * v)
    speed = lfilter([0.0, 1.0], [1.0, -a], kick) + p[3] * a ** np.arange(len(u))
    return p[2] + np.concatenate([[0.0], np.cumsum(g * speed[:-1] + way[:-1])])


def friction_position(p: Array, u: Array, sample_time: float) -> Array:
    """The position for p = (ln K, ln τ, θ₀, ω₀, u_c), with stops and reversals at their exact times."""
    gain, tau, angle, speed, lost = math.exp(p[0]), math.exp(p[1]), float(p[2]), float(p[3]), float(p[4])
    a = math.exp(-sample_time / tau)
    out = np.empty(len(u))
    for k, volt in enumerate(u.tolist()):
        out[k] = angle
        left, decay = sample_time, a
        while left > 0.0:
            if speed == 0.0 and abs(volt) <= lost:
                break
            sense = math.copysign(1.0, speed if speed != 0.0 else volt)
            target = gain * (volt - lost * sense)
            end = target + (speed - target) * decay
            if speed == 0.0 or end * speed > 0.0:
                angle += target * left + (speed - target) * tau * (1.0 - decay)
                speed = end
                break
            until = tau * math.log1p(-speed / target)
            angle += target * until + speed * tau
            angle -= target * tau * (1.0 - math.exp(-until / tau)) + speed * tau * math.exp(-until / tau)
            speed, left = 0.0, left - until
            decay = math.exp(-max(left, 0.0) / tau)
    return out


def _fit(simulate, record: Record, start: list[float], free: list[int]) -> Answer:
    """Least squares over the parameters at `free`, the others stay; sd from s² (J'J)⁻¹, as white residuals would have it."""
    y, u, sample_time = record.position, record.u, record.sample_time
    base = np.array(start)

    def residual(q: Array) -> Array:
        p = base.copy()
        p[free] = q
        return (y - simulate(p, u, sample_time)) / QUANTUM

    found = least_squares(residual, base[free], method="lm", x_scale="jac", max_nfev=400 * len(free))
    cost = 2.0 * found.cost / (len(y) - len(free))
    sd = np.sqrt(cost * np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    gain, tau = math.exp(found.x[0]), math.exp(found.x[1])
    return Answer(
        gain=gain,
        time_constant=tau,
        gain_interval=interval(gain, gain * sd[0]),
        time_constant_interval=interval(tau, tau * sd[1]),
        interval_from="hand",
        note="" if found.success else "not converged",
    )


def _start(record: Record) -> list[float]:
    gain = float(record.speed @ record.u[:-1]) / float(record.u[:-1] @ record.u[:-1])
    return [math.log(gain), math.log(0.05), float(record.position[0]), 0.0, 0.0]


def linear(free: list[int], delay: float = 0.0) -> Method:
    return lambda record: _fit(linear_position, record, [*_start(record), delay * record.sample_time], free)


def friction(record: Record) -> Answer:
    return _fit(friction_position, record, _start(record), [0, 1, 2, 3, 4])


METHODS = {
    "scipy position OE": linear([0, 1, 2, 3]),
    "scipy position OE + offset": linear([0, 1, 2, 3, 4]),
    "scipy position OE + offset + delay": linear([0, 1, 2, 3, 4, 5], delay=0.3),
    "scipy position OE + friction": friction,
}

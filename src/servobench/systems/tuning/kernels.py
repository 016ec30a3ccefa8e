"""A unit step of a control law's reference around the motor of first order, compiled: each tick rounded as Python rounds it.

From τ dω/dt = -ω + K u follows, by algebra, ω(t) = K u + (ω₀ - K u) e^(-t/τ) under a constant voltage u; the angle is its
integral.
"""

from __future__ import annotations

import math

from servobench.core.channels import Array
from servobench.core.compiled import strictly_compiled
from servobench.systems.control import kernels as laws

RESOLUTION = 1e-9
"""The angle of a count [rad], finer than any encoder, for the response of the loop itself."""
_FAR = 2.0**61  # counts, at which the counter stays: the difference of two is one of 64 bits, too


@strictly_compiled
def follow_step(
    law: int, p: Array, x: Array, new: Array, gain: float, tau: float, whole: int, part: float, course: Array
) -> None:
    """Fill the output [rad or rad/s] and the voltage that is wanted [V] at each tick (T, 2); the step comes at the second one.

    `law` is the number of a law of numbers `p` (P,), whose states `x` (X,) and `new` (X,) are room for the next ones. The motor
    K/(τs + 1) has its `gain` K [rad/(s·V)] and `tau` τ [s]; a voltage acts after so many `whole` ticks and a `part` [s] of one,
    in which the one before it still does.
    """
    h = p[laws.SAMPLE_TIME]
    at_part, at_rest = math.exp(-part / tau), math.exp(-(h - part) / tau)
    angle = speed = 0.0
    for k in range(len(course)):
        counts = math.floor(max(-_FAR, min(_FAR, angle / RESOLUTION)))
        reference = 1.0 if k > 0 else 0.0
        course[k, 0] = speed if p[laws.FOLLOWS_SPEED] != 0.0 else angle
        course[k, 1] = laws.voltage_of(law, new, x, p, reference, counts, k * h)
        x, new = new, x
        before = course[k - whole - 1, 1] if k > whole else 0.0
        angle, speed = coast(angle, speed, gain * before, tau, part, at_part)
        held = course[k - whole, 1] if k >= whole else 0.0
        angle, speed = coast(angle, speed, gain * held, tau, h - part, at_rest)


@strictly_compiled
def coast(
    angle: float, speed: float, end: float, tau: float, length: float, left: float
) -> tuple[float, float]:
    """Return angle and speed after a time [s] in which the speed tends to an `end` and a part is `left` of what it was off."""
    angle += tau * (1 - left) * (speed - end) + length * end
    return angle, left * speed + (1 - left) * end

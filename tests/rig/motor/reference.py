"""The motor's equations in steps so short that no scheme matters: the truth that solvers and models are held against.

Independent of `servobench.rig.motor`: written from the equations, with its own friction rule.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray


class Truth(NamedTuple):
    """Physical parameters in SI units."""

    resistance: float = 8.4
    inductance: float = 1.16e-3
    motor_constant: float = 0.042
    inertia: float = 2.0951778e-5
    viscous_friction: float = 1e-6
    coulomb_torque: float = 8e-4


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _march(p, u, substeps, dt, start, out, kicks):  # type: ignore[no-untyped-def]
    r, l, k, j, b, tc = p
    i, w, theta = start
    half = np.exp(-0.5 * dt * r / l)
    whole = half * half
    # Of a step of the speed: what is left of the speed, what each ampere adds, and what friction takes at most.
    kept = (1.0 - 0.5 * dt * b / j) / (1.0 + 0.5 * dt * b / j)
    push = dt * k / j / (1.0 + 0.5 * dt * b / j)
    stop = dt * tc / j
    # The current goes to (u - k w)/r. Dividing in each step would take most of the time.
    per_volt, per_speed = 1.0 / r, k / r
    for n in range(len(u)):
        out[n, 0], out[n, 1], out[n, 2] = i, w, theta
        end = per_volt * u[n]
        # Strang splitting, second order: half a step of the current, exact for a held speed; a step of the speed with the
        # current of the middle, friction implicit; the other half of the current. That one and the next step's first half are
        # one whole step, as the speed is the same in both.
        i = half * i + (1.0 - half) * (end - per_speed * w)
        for step in range(substeps):
            free = kept * w + push * i
            w_new = free - stop if free > stop else free + stop if free < -stop else 0.0
            theta += 0.5 * dt * (w + w_new)
            w = w_new
            if len(kicks) and w != 0.0:
                w += kicks[n, step]
            if step < substeps - 1:
                i = whole * i + (1.0 - whole) * end - (1.0 - whole) * per_speed * w
        i = half * i + (1.0 - half) * (end - per_speed * w)


def march(
    truth: Truth,
    u: NDArray[np.float64],
    sample_time: float,
    step: float = 5e-6,
    angle: float = 0.0,
    torque_noise: float = 0.0,
    seed: int = 0,
) -> NDArray[np.float64]:
    """Return current, speed and angle (N, 3), latched before each input u (N,) acts, from rest at an angle [rad].

    `torque_noise` is the intensity s_T of a white torque, two-sided [N·m/√Hz]: each step adds s_T/J √step times a normal number
    to the speed of a shaft that moves.
    """
    substeps = round(sample_time / step)
    out = np.empty((len(u), 3))
    kicks = np.empty((0, 0))
    if torque_noise:
        kicks = np.random.default_rng(seed).standard_normal((len(u), substeps))
        kicks *= torque_noise / truth.inertia * np.sqrt(sample_time / substeps)
    _march(tuple(truth), u, substeps, sample_time / substeps, (0.0, 0.0, angle), out, kicks)
    return out

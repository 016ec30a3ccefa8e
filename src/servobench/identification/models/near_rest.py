"""Friction that may be larger near rest than at speed, as far as nobody has seen it.

It is larger by anything up to half of the friction at speed, into which it falls within a tenth of the largest speed
(Armstrong-Hélouvry, Dupont and Canudas de Wit 1994 collect such figures). That it is larger by what matters has a chance of a
quarter before anything was seen, which is a choice (docs/decisions/0047-one-lag.md). What it does to the output is the derivative
by the Stribeck voltage u_s of the motor with the friction u_c + u_s e^(-|ω|/ω_s), at u_s = 0 (`models.nonlinear`).
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.identification.models.base import Structure
from servobench.identification.models.first_order import FirstOrder
from servobench.identification.models.nonlinear.structure import NonlinearMotor
from servobench.identification.models.second_order.structure import SecondOrder
from servobench.recordings.measurement.dataset import Dataset

MOST = 0.5
"""Of the friction at speed."""
CHANCE = 0.25
"""That there is any."""
_FALLS = 0.1  # of the largest speed


def most_near_rest(structure: Structure, theta: Array, data: Dataset) -> Array:
    """Return what the output has more (M,) where friction near rest is larger by the most that it may be.

    `theta` (P + Q,) is that of `predict`. It is zero where the structure isn't that of a motor with a known friction.
    """
    from servobench.identification.models.nonlinear import kernels

    nothing = np.zeros(len(data.y))
    if not isinstance(structure, FirstOrder | NonlinearMotor | SecondOrder):
        return nothing
    value = dict(zip((parameter.name for parameter in structure.parameters), theta, strict=False))
    friction = float(value.get("coulomb_voltage", 0.0))
    if "stribeck_voltage" in value or not friction > 0.0:
        return nothing
    at = {
        "gain": kernels.GAIN,
        "time_constant": kernels.TAU,
        "offset_voltage": kernels.OFFSET,
        "coulomb_voltage": kernels.COULOMB,
        "delay": kernels.DELAY,
        "gravity_voltage_sine": kernels.SINE,
        "gravity_voltage_cosine": kernels.COSINE,
        "load_friction": kernels.LOAD,
        "drag_asymmetry": kernels.ASYMMETRY,
    }
    p = np.zeros(kernels.COLUMNS)
    for name in value.keys() & at.keys():
        p[at[name]] = value[name]
    p[kernels.DELAY] += data.delay
    own = 2 if data.kind == "position" else 1
    p[kernels.COLUMNS - own :] = theta[len(structure.parameters) :][:own]
    p[kernels.STRIBECK_SPEED] = 1.0
    gravity, t = bool(p[kernels.SINE] or p[kernels.COSINE]), data.t_output
    held = (data.t_input, data.u, data.input_before, t)
    speed, none = np.empty(len(t)), np.empty((len(t), 0))
    kernels.response(*held, p, True, False, gravity, True, np.empty(0, dtype=np.int64), speed, none)
    p[kernels.STRIBECK_SPEED] = _FALLS * float(np.abs(speed).max(initial=0.0)) or 1.0
    wanted, y, jacobian = np.array([kernels.STRIBECK]), np.empty(len(t)), np.empty((len(t), 1))
    of_speed = data.shaft_kind == "speed"
    kernels.response(*held, p, True, True, gravity, of_speed, wanted, y, jacobian)
    column = MOST * friction * jacobian
    return data.chain.linear(column, t)[:, 0] if np.isfinite(column).all() else nothing

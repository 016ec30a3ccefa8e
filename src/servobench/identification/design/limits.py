"""The limits of an experiment: for the motor, for the rig, and in time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import MissingInformation, UsageError
from servobench.identification.design.assumed_motor import AssumedMotor


@dataclass(frozen=True, kw_only=True)
class DesignLimits:
    """The largest voltage [V], current [A], speed [rad/s] and travel [rad], either way; None where there is no limit.

    Travel is counted from where the motor starts. Raises `UsageError` for a limit that leaves nothing.
    """

    voltage: float
    current: float | None = None
    speed: float | None = None
    travel: float | None = None

    def __post_init__(self) -> None:
        for name in ("voltage", "current", "speed", "travel"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise UsageError(f"the limit of the {name} is {value!r}; expected a finite number above 0")

    def check(self, motor: AssumedMotor) -> None:
        """Raise `MissingInformation` for a limit that nothing is known for."""
        if self.current is not None and (motor.resistance is None or motor.motor_constant is None):
            raise MissingInformation(
                motor.name,
                [
                    "resistance and torque constant are needed to predict the current: name the motor's data sheet "
                    "(`nominal=...`), or leave out `current=...`"
                ],
            )


def limit_use(motor: AssumedMotor, limits: DesignLimits, t: Array, u: Array) -> Mapping[str, float]:
    """Return what part of each limit an experiment with the input u (N,) at t (N,) [s] uses, 1 for all of it.

    It is the most that any motor within the tolerance does: gain and time constant at their ends.
    """
    parts = {"voltage": float(np.abs(u).max()) / limits.voltage}
    limited = {name for name in ("current", "speed", "travel") if getattr(limits, name) is not None}
    if not limited:
        return parts
    ends = (1 - motor.tolerance, 1 + motor.tolerance)
    most = dict.fromkeys(limited, 0.0)
    for gain, tau in product(ends, ends):
        position, speed = motor.motion(t, u, gain, tau)
        peaks = {
            "speed": float(np.abs(speed).max()),
            "travel": float(np.abs(position).max()),
            "current": _current(motor, u, speed),
        }
        most = {name: max(most[name], peaks[name]) for name in limited}
    return parts | {name: value / float(getattr(limits, name)) for name, value in most.items()}


def _current(motor: AssumedMotor, u: Array, speed: Array) -> float:
    """The largest current [A], (u - k ω)/R just after each change of the input, which the inductance only makes smaller."""
    if motor.resistance is None or motor.motor_constant is None:
        return 0.0
    least = motor.resistance * (1 - motor.tolerance)
    # The input of a sample meets the speed at that sample, and what the speed has become by the next.
    held = np.abs(u - motor.motor_constant * speed)
    after = np.abs(u[:-1] - motor.motor_constant * speed[1:])
    return float(max(held.max(), after.max(initial=0.0))) / least

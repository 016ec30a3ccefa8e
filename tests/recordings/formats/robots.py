"""The four standard tests of WPILib's SysId on the reference motor: as its JSON, and as rows."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tests.rig.motor.reference import Truth, march

COUNTS = 4096  # in a turn
STEP, RAMP = 7.0, 1.0  # V of the dynamic tests, V/s of the quasistatic ones
LENGTHS = {"slow-forward": 8.0, "slow-backward": 8.0, "fast-forward": 2.5, "fast-backward": 2.5}  # s


class Constants(NamedTuple):
    """The constants from the algebra of the motor's equation: kS [V], kV [V·s/rev], kA [V·s²/rev]."""

    ks: float
    kv: float
    ka: float


def constants_of(truth: Truth) -> Constants:
    """The feedforward of a motor without a winding's lag: u = (R/k) T_c + (k + R b/k) ω + (R J/k) dω/dt."""
    per_rev, ratio = 2 * np.pi, truth.resistance / truth.motor_constant
    return Constants(
        ks=ratio * truth.coulomb_torque,
        kv=per_rev * (truth.motor_constant + ratio * truth.viscous_friction),
        ka=per_rev * ratio * truth.inertia,
    )


def rows(test: str, truth: Truth, period: float, counts: int = COUNTS) -> NDArray[np.float64]:
    """Time, voltage, position [rev] and velocity [rev/s] of a test from rest (N, 4).

    A row has the voltage that acted until its time, as SysId's logger writes it; the velocity is the counts' difference.
    """
    t = period * np.arange(round(LENGTHS[test] / period))
    u = RAMP * t if test.startswith("slow") else np.full(len(t), STEP)
    u = u if test.endswith("forward") else -u
    turns = march(truth, u, period, step=period / 200, angle=0.3)[:, 2] / (2 * np.pi)
    position = np.floor(turns * counts) / counts
    velocity = np.concatenate([[0.0], np.diff(position) / period])
    before = np.concatenate([[0.0], u[:-1]])
    return np.column_stack([t, before, position, velocity])


def sysid_json(
    truth: Truth | None = None, period: float = 0.005, tests: tuple[str, ...] = tuple(LENGTHS), **head: Any
) -> str:
    """A file of SysId with these tests, a mechanism's."""
    content: Mapping[str, Any] = {
        "sysid": True, "test": "Simple", "units": "Rotations", "unitsPerRotation": 1.0, **head,
        **{test: rows(test, truth or Truth(), period).tolist() for test in tests},
    }  # fmt: skip
    return json.dumps(content)

"""The motors of an ensemble: their parameters, gain and time constant, and the coefficients that they are simulated with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.rig.ensemble.lanes import LANES
from servobench.rig.motor.physics import Physics


@dataclass(frozen=True, kw_only=True, eq=False)
class Motors:
    """The true parameters of n motors, each (n,): those of the winding, and of the amplifier whose `series` resistance [Ω] adds.

    `parameters` has a row for each name of `tolerances.PARAMETERS`.
    """

    parameters: Mapping[str, Array]
    series: float = 0.0

    def __len__(self) -> int:
        return len(self.parameters["resistance"])

    @property
    def physics(self) -> Array:
        """R with what is in series, L, k, J, b and T_c of each (6, n), in SI units."""
        p = self.parameters
        names = ("inductance", "motor_constant", "inertia", "viscous_friction", "coulomb_torque")
        return np.stack([p["resistance"] + self.series, *(p[name] for name in names)])

    @property
    def gain(self) -> Array:
        """K = k/(R b + k²) of each (n,) [rad/(s·V)]."""
        r, _, k, _, b, _ = self.physics
        return np.asarray(k / (r * b + k * k))

    @property
    def time_constant(self) -> Array:
        """τ of each (n,) [s]: -1 over the real part of the slow eigenvalue."""
        r, l, k, j, b, _ = self.physics
        # λ² L J + λ (R J + L b) + R b + k² = 0; written so that it holds for L = 0, too: τ = -1/λ.
        trace, det = r * j + l * b, r * b + k * k
        root = np.sqrt(np.maximum(trace**2 - 4 * l * j * det, 0.0))
        return np.asarray(np.where(trace**2 < 4 * l * j * det, 2 * l * j / trace, (trace + root) / (2 * det)))

    def one(self, number: int) -> Physics:
        """Return one of the motors as the twin's solver takes it."""
        r, l, k, j, b, tc = self.physics[:, number].tolist()
        return Physics(
            resistance=r,
            inductance=l,
            motor_constant=k,
            inertia=j,
            viscous_friction=b,
            coulomb_torque=tc,
        )

    def coefficients(self, tick: float, torque_noise: float, counts_per_rev: float) -> Array:
        """Return the kernels' coefficients (ROWS, M) for ticks of that length [s], M the next multiple of 16.

        The last motor is repeated up to there. `torque_noise` [N·m/√Hz] is the intensity of a white torque.
        """
        from servobench.rig.ensemble import kernels as at

        n = len(self)
        padded = -(-n // LANES) * LANES
        c, unsolved = np.empty((at.ROWS, padded)), np.zeros(n)
        at.hold(np.ascontiguousarray(self.physics), tick, torque_noise, c[:, :n], unsolved)
        for number in np.flatnonzero(unsolved):
            c[:, number] = _by_series(self.one(int(number)), tick, torque_noise)
        c[at.LIMIT, :n] = self.parameters["amplifier_limit"]
        c[at.SCALE, :n] = counts_per_rev / (2 * math.pi)
        c[:, n:] = c[:, n - 1 : n]
        return c


def _by_series(physics: Physics, tick: float, torque_noise: float) -> Array:
    """The coefficients (ROWS,) of a motor whose roots are complex or nearly equal, by a matrix exponential."""
    from servobench.rig.ensemble import kernels as at
    from servobench.rig.motor import kernels as motor
    from servobench.rig.motor.solvers.exact import coefficients

    # With a Coulomb torque of 1 the drop of the speed is that of a torque of 1.
    unit = coefficients(Physics(**{**vars(physics), "coulomb_torque": 1.0}), tick)
    c = np.zeros(at.ROWS)
    names = ("A00", "A01", "B0", "A10", "A11", "B1", "T0", "T1", "TB", "G", "Q")
    c[[getattr(at, name) for name in names]] = unit[[getattr(motor, name) for name in names]]
    c[at.C1] = unit[motor.C1] * physics.coulomb_torque
    c[at.SHOCK] = unit[motor.C1] * torque_noise / math.sqrt(tick)
    return c

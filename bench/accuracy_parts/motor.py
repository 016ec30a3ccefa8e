"""The reference motor, and what the estimates of a motor are compared with."""

from dataclasses import dataclass, replace

import numpy as np

STRIBECK_SPEED = 2.0  # rad/s


@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor in SI units; without inductance and Coulomb friction it is the one of the published bounds."""

    resistance: float = 8.4
    inductance: float = 0.0
    constant: float = 0.042
    inertia: float = 2.1e-5
    viscous: float = 5e-6
    coulomb: float = 0.0  # N·m

    @property
    def gain(self) -> float:
        """Steady speed for a volt [rad/(s·V)]: k/(R b + k²)."""
        return self.constant / (self.resistance * self.viscous + self.constant**2)

    @property
    def time_constant(self) -> float:
        """J R/(R b + k²) [s]: that of the speed where the winding is fast."""
        return self.inertia * self.resistance / (self.resistance * self.viscous + self.constant**2)

    @property
    def coulomb_voltage(self) -> float:
        """The voltage that Coulomb friction takes [V]: T R/k."""
        return self.coulomb * self.resistance / self.constant

    def drawn(self, random: np.random.Generator) -> "Motor":
        """Return the motor with inertia and torque constant drawn within ±5 %."""
        j, k = 1 + 0.05 * (2 * random.random(2) - 1)
        return replace(self, inertia=self.inertia * j, constant=self.constant * k)


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The true values to compare estimates with: a range for each, most often of no width, with what else is known.

    Where the motor changes during the record an estimate inside the range of the true values isn't wrong.
    """

    gain: tuple[float, float]
    time_constant: tuple[float, float]
    delay: float

    @classmethod
    def of(cls, gain: float, time_constant: float, delay: float = 0.0) -> "Truth":
        """Return the truth about a motor that stays as it is."""
        return cls(gain=(gain, gain), time_constant=(time_constant, time_constant), delay=delay)

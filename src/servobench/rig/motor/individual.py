"""An individual simulated motor: its parameters are always the same for a secret, an exercise and a name.

The gain K, the time constant τ, the Coulomb voltage u_c, the resistance R and the viscous friction b are drawn independently;
the other parameters follow from them:

    k = (1 + √(1 - 4 K² R b)) / 2K,   J = τ (R b + k²)/R,   T_c = u_c k/R

so that the measured parameters (docs/decisions/0027-assessment.md) are spread evenly over their ranges and independent of each
other.
"""

from __future__ import annotations

import math
import unicodedata
from dataclasses import dataclass
from typing import Any

from servobench.rig.motor.secret import hash_words

_PURPOSE = "servobench.individual/1"

GAIN = (16.0, 34.0)
"""Range of the gain K [rad/(s·V)]; evenly spread in its logarithm."""
TIME_CONSTANT = (0.04, 0.14)
"""Range of the time constant τ [s]; evenly spread in its logarithm."""
COULOMB_VOLTAGE = (0.06, 0.3)
"""Range of the Coulomb voltage u_c [V]."""
RESISTANCE = (5.0, 13.0)
"""Range of the winding's resistance R [Ω]."""
VISCOUS_FRICTION = (0.3e-6, 3e-6)
"""Range of the viscous friction b [N·m·s/rad]."""
START_ANGLE = (-0.003, 0.003)
"""Range of the angle of the shaft at the start [rad]: a count or so; from farther away, position loops begin with a jump."""


@dataclass(frozen=True, kw_only=True)
class Individual:
    """The individual parameters of a simulated motor: `resistance` [Ω], `motor_constant` [V·s/rad], `inertia` [kg·m²].

    `viscous_friction` [N·m·s/rad], `coulomb_torque` [N·m], `start_angle` [rad]; `noise_seed` is the seed of its sensors' noise.
    """

    resistance: float
    motor_constant: float
    inertia: float
    viscous_friction: float
    coulomb_torque: float
    start_angle: float
    noise_seed: int

    @property
    def twin_settings(self) -> dict[str, Any]:
        """The settings of a twin that is this motor; rotor, hub and disc are one inertia."""
        return {
            "resistance": self.resistance,
            "motor_constant": self.motor_constant,
            "rotor_inertia": self.inertia,
            "hub_inertia": 0.0,
            "disc_inertia": 0.0,
            "viscous_friction": self.viscous_friction,
            "coulomb_torque": self.coulomb_torque,
            "start_angle": self.start_angle,
        }


def same_name(name: str) -> str:
    """Return a name as it counts: capitals, blanks around and between, and ways to write one letter make no other person."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def individual(secret: bytes, exercise: str, name: str) -> Individual:
    """Return the motor that belongs to a name in an exercise; without the secret nothing of it can be worked out."""

    def part(quantity: str) -> float:
        """A number from 0 to 1, drawn for this quantity alone: who finds one out knows no other."""
        digest = hash_words(secret, _PURPOSE, exercise, same_name(name), quantity)
        return (int.from_bytes(digest[:8], "big") >> 11) / 2.0**53

    def even(quantity: str, limits: tuple[float, float]) -> float:
        return limits[0] + (limits[1] - limits[0]) * part(quantity)

    def even_ratio(quantity: str, limits: tuple[float, float]) -> float:
        return float(limits[0] * math.exp(math.log(limits[1] / limits[0]) * part(quantity)))

    gain, time_constant = even_ratio("gain", GAIN), even_ratio("time_constant", TIME_CONSTANT)
    resistance, damping = even("resistance", RESISTANCE), even("viscous_friction", VISCOUS_FRICTION)
    # K k² - k + K R b = 0: of its two roots the larger one is the motor whose friction brakes it less than its winding does.
    constant = (1.0 + math.sqrt(1.0 - 4.0 * gain**2 * resistance * damping)) / (2.0 * gain)
    return Individual(
        resistance=resistance,
        motor_constant=constant,
        inertia=time_constant * (resistance * damping + constant**2) / resistance,
        viscous_friction=damping,
        coulomb_torque=even("coulomb_voltage", COULOMB_VOLTAGE) * constant / resistance,
        start_angle=even("start_angle", START_ANGLE),
        noise_seed=int.from_bytes(
            hash_words(secret, _PURPOSE, exercise, same_name(name), "noise")[:16], "big"
        ),
    )

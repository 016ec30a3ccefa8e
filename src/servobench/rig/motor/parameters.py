"""Motors by name: the values of their data sheets, each with its source.

A data sheet has no friction unless its maker gives one: friction is what an identification finds, not what a nominal model knows.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from servobench.core.arguments import check_type
from servobench.core.errors import UnknownName, UsageError


@dataclass(frozen=True, kw_only=True)
class MotorParameters:
    """The physical parameters of a DC motor with its load, in SI units.

    `motor_constant` is both the torque constant k_t [N·m/A] and the back-emf constant k_m [V·s/rad], equal in SI units.
    `resistance` [Ω] and `inductance` [H] belong to the winding; `rotor_inertia`, `hub_inertia` and `disc_inertia` [kg·m²] add
    up; `viscous_friction` [N·m·s/rad] and `coulomb_torque` [N·m] belong to the bearings and brushes.
    Raises `UsageError` for a value that no motor has.
    """

    resistance: float
    inductance: float
    motor_constant: float
    rotor_inertia: float
    hub_inertia: float = 0.0
    disc_inertia: float = 0.0
    viscous_friction: float = 0.0
    coulomb_torque: float = 0.0

    def __post_init__(self) -> None:
        for name in ("resistance", "motor_constant", "inertia"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise UsageError(
                    f"motor: {name} is {getattr(self, name)!r}; expected a finite number above 0"
                )
        for name in ("inductance", "viscous_friction", "coulomb_torque"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise UsageError(
                    f"motor: {name} is {getattr(self, name)!r}; expected a finite number, 0 or above"
                )

    @property
    def inertia(self) -> float:
        """J, all that turns: rotor + hub + disc [kg·m²]."""
        return self.rotor_inertia + self.hub_inertia + self.disc_inertia


@dataclass(frozen=True, kw_only=True)
class DataSheet:
    """A motor as its papers describe it: parameters, voltage limit and dead band [V], and encoder.

    `name` is that under which it is found, `counts_per_rev` and `counter_bits` are the encoder's; `sources` says of each
    parameter where its value stands.
    """

    name: str
    motor: MotorParameters
    voltage_limit: float
    dead_band: float
    counts_per_rev: int
    counter_bits: int
    sources: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))


def disc_inertia(mass: float, radius: float) -> float:
    """Return J of a homogeneous disc about its axis [kg·m²], by definition ∫ r² dm = m r²/2; mass in kg, radius in m."""
    return 0.5 * mass * radius**2


_HUB = disc_inertia(0.0106, 0.0111)
_DISC = disc_inertia(0.053, 0.0248)

QUBE_SERVO_2 = DataSheet(
    name="qube_servo_2",
    motor=MotorParameters(
        resistance=8.4,
        inductance=1.16e-3,
        motor_constant=0.042,
        rotor_inertia=4.0e-6,
        hub_inertia=_HUB,
        disc_inertia=_DISC,
    ),
    voltage_limit=10.0,
    dead_band=0.0,
    counts_per_rev=2048,
    counter_bits=24,
    sources={
        "resistance": "Quanser QUBE-Servo 2 user manual, system parameters; Table 1 of the paper",
        "inductance": "Quanser QUBE-Servo 2 user manual, system parameters; Table 1 of the paper",
        "motor_constant": "Quanser QUBE-Servo 2 user manual: k_t = 0.042 N·m/A, k_m = 0.042 V·s/rad; Table 1 of the paper",
        "rotor_inertia": "Quanser QUBE-Servo 2 user manual; Table 1 of the paper (which then leaves it out of J_eq)",
        "hub_inertia": "m r²/2 with 0.0106 kg and 0.0111 m, Table 1 of the paper",
        "disc_inertia": "m r²/2 with 0.053 kg and 0.0248 m, Table 1 of the paper",
        "voltage_limit": "recommended range of the drive, ±10 V",
        "dead_band": "not given; assumed 0",
        "counts_per_rev": "512 lines, read in quadrature; section II.B of the paper",
        "counter_bits": "24-bit counter of the Q2 interface; not confirmed by a manual",
    },
)

QUBE_SERVO_3 = DataSheet(
    name="qube_servo_3",
    motor=MotorParameters(
        resistance=7.5,
        inductance=1.15e-3,
        motor_constant=0.0422,
        rotor_inertia=1.4e-6,
        hub_inertia=_HUB,
        disc_inertia=_DISC,
    ),
    voltage_limit=10.0,
    dead_band=0.65,
    counts_per_rev=2048,
    counter_bits=24,
    sources={
        "resistance": "Quanser QUBE-Servo 3 user manual, Table 2.2: 7.5 Ω, ±12 %",
        "inductance": "Quanser QUBE-Servo 3 user manual, Table 2.2: 1.15 mH at 1 kHz",
        "motor_constant": "Quanser QUBE-Servo 3 user manual, Table 2.2",
        "rotor_inertia": "Quanser QUBE-Servo 3 user manual, Table 2.2",
        "hub_inertia": "m r²/2 with 0.0106 kg and 0.0111 m, user manual",
        "disc_inertia": "m r²/2 with 0.053 kg and 0.0248 m, user manual",
        "voltage_limit": "Quanser QUBE-Servo 3 user manual: ±10 V recommended, ±15 V at most",
        "dead_band": "Quanser QUBE-Servo 3 user manual: 0.65 V unless the driver compensates for it",
        "counts_per_rev": "US Digital E8P, 512 lines, read in quadrature",
        "counter_bits": "Quanser QUBE-Servo 3 user manual: two 24-bit channels",
    },
)

DATA_SHEETS: Mapping[str, DataSheet] = MappingProxyType({s.name: s for s in (QUBE_SERVO_2, QUBE_SERVO_3)})


def nominal_motor(nominal: object) -> MotorParameters | None:
    """Return the parameters that a motor should have, of a data sheet's name or given as they are; None of None.

    Raises `UnknownName` for a name of no data sheet, and `UsageError` for anything else.
    """
    if nominal is None or isinstance(nominal, MotorParameters):
        return nominal
    check_type(
        "nominal", nominal, str, "the name of a data sheet, such as 'qube_servo_2', or MotorParameters"
    )
    return data_sheet(str(nominal)).motor


def data_sheet(name: str) -> DataSheet:
    """Return the data sheet of that name; raises `UnknownName`, which lists the known ones."""
    if name not in DATA_SHEETS:
        raise UnknownName("data sheet", name, DATA_SHEETS)
    return DATA_SHEETS[name]

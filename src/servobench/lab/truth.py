"""The true parameters of a simulated motor, computed from its settings, to compare estimates with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from servobench.core.errors import NotIdentifiable

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Truth:
    """A simulated motor's true figures, in SI units.

    `gain` K = k/(R b + k²) [rad/(s·V)], which follows from R i + k ω = u and k i = b ω; `time_constant` τ = -1 over the slow
    pole [s]; `coulomb_voltage` T_c R/k [V]; `delay` [s], the pure one and the fast pole's time constant, which a first-order
    model sees as one. `resistance` R [Ω] is the winding's and the amplifier's; then the motor constant k [V·s/rad], the inertia
    J [kg·m²], the viscous friction b [N·m·s/rad] and the Coulomb torque T_c [N·m].
    """

    gain: float
    time_constant: float
    coulomb_voltage: float
    delay: float
    resistance: float
    motor_constant: float
    inertia: float
    viscous_friction: float
    coulomb_torque: float


def truth_if_known(recording: Recording) -> Truth | None:
    """Return the true figures of the simulated motor behind a recording; None for another device, and for a student's own."""
    return truth_of(recording) if recording.info is not None and recording.info.name == "twin" else None


def truth_of(recording: Recording) -> Truth:
    """Return the true figures of the simulated motor behind a recording, from the settings that it was connected with.

    Raises `NotIdentifiable` for another motor, whose true parameters nobody knows.
    """
    from servobench.rig.devices.twin import TwinSettings
    from servobench.rig.motor.physics import Physics

    info = recording.info
    if info is None or info.name != "twin":
        raise NotIdentifiable(
            "this compares estimates with the motor's true parameters, which aren't known for the motor in "
            f"{recording.name}; do the exercise with the simulated one"
        )
    values = {name: value for name, value in info.settings if name in TwinSettings.model_fields}
    settings = TwinSettings.model_validate(values)
    motor = Physics.of(settings.parameters, settings.amplifier_resistance)
    fast = [-1.0 / pole.real for pole in motor.eigenvalues[1:]]
    return Truth(
        gain=motor.gain,
        time_constant=motor.time_constant,
        coulomb_voltage=motor.coulomb_voltage,
        delay=settings.delay + sum(fast),
        resistance=motor.resistance,
        motor_constant=motor.motor_constant,
        inertia=motor.inertia,
        viscous_friction=motor.viscous_friction,
        coulomb_torque=motor.coulomb_torque,
    )

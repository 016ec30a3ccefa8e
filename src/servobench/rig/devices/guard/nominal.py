"""The motor that the guard assumes: by numbers, by the name of a data sheet, or by the device's own information."""

from __future__ import annotations

from servobench.core.channels import DeviceInfo
from servobench.rig.devices.guard.base import Nominal
from servobench.rig.experiment.limits import Plausibility
from servobench.rig.motor.parameters import DATA_SHEETS, data_sheet


def nominal_motor(known: Plausibility | None, info: DeviceInfo) -> Nominal | None:
    """Return what is known of the motor beforehand, None where nothing is or nothing shall be made of it.

    With a data sheet the gain is K = 1/k and the time constant τ = R J / k²: it has no viscous friction.
    Raises `UnknownName` for the name of a data sheet that there isn't.
    """
    if known is None:
        return None
    own = dict(info.settings).get("motor", "")
    name = known.motor or (own if own in DATA_SHEETS else "")
    if known.gain is not None and known.time_constant is not None:
        return Nominal(
            gain=known.gain,
            time_constant=known.time_constant,
            coulomb_voltage=known.coulomb_voltage,
            resistance=known.resistance,
        )
    if not name:
        return None
    motor = data_sheet(name).motor
    return Nominal(
        gain=1 / motor.motor_constant,
        time_constant=motor.resistance * motor.inertia / motor.motor_constant**2,
        coulomb_voltage=known.coulomb_voltage,
        resistance=known.resistance or motor.resistance,
    )

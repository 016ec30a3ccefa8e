"""The tolerance of each parameter of a motor, and motors drawn at random within them.

A parameter lies evenly between value - half and value + half, as for a data sheet's tolerance of which nothing more is known
(JCGM 100:2008, 4.3.7); the parameters are independent of each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from servobench.core.arguments import check_mapping, text_of_value
from servobench.core.channels import Array
from servobench.core.errors import UnitError, UnknownName, UsageError
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import SPACE, with_unit
from servobench.core.units import quantity
from servobench.rig.devices.twin import TwinSettings

PARAMETERS: Mapping[str, str] = MappingProxyType(
    {
        "resistance": "Ω",
        "motor_constant": "V·s/rad",
        "inertia": "kg·m²",
        "viscous_friction": "N·m·s/rad",
        "coulomb_torque": "N·m",
        "inductance": "H",
        "amplifier_limit": "V",
    }
)
"""The parameters that may have a tolerance, and their units; a motor's draws are in this order, whichever have one."""

_MAY_BE_ZERO = ("viscous_friction", "coulomb_torque", "inductance")


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """The parameter `name` lies anywhere from `value` - `half` to `value` + `half`, equally likely, in its unit."""

    name: str
    value: float
    half: float

    @property
    def unit(self) -> str:
        """The unit of value and half."""
        return PARAMETERS[self.name]

    @property
    def relative(self) -> float:
        """Half of the range as a part of the value."""
        return self.half / self.value if self.value else math.inf

    def __str__(self) -> str:
        half = f"{100 * self.relative:.3g}{SPACE}%" if self.value else with_unit(self.half, self.unit, 3)
        return f"{parameter_in_words(self.name)} {with_unit(self.value, self.unit)} ±{SPACE}{half}"


def nominal_values(motor: TwinSettings) -> dict[str, float]:
    """Return the parameters of a twin about which the tolerances lie, in the order of `PARAMETERS`."""
    known = motor.parameters
    limit = motor.data_sheet.voltage_limit if motor.amplifier_limit is None else motor.amplifier_limit
    return {name: float(getattr(known, name, limit)) for name in PARAMETERS}


def tolerances_of(motor: TwinSettings, spread: Mapping[str, object]) -> tuple[Tolerance, ...]:
    """Return the tolerances of a motor, one for each parameter that `spread` names.

    A tolerance is a part of the value (0.1, or the text "10%") or a half width with its unit ("0.8 ohm"). Raises `UnknownName`
    for a name that has none, and `UsageError` for a tolerance that no motor can have.
    """
    check_mapping("spread", spread, '{"resistance": "10%"}')
    values = nominal_values(motor)
    for name in spread:
        if name not in PARAMETERS:
            raise UnknownName("parameter with a tolerance", name, PARAMETERS)
    return tuple(_tolerance(name, values[name], spread[name]) for name in PARAMETERS if name in spread)


def draw_motors(
    motor: TwinSettings, tolerances: tuple[Tolerance, ...], n: int, seed: int
) -> dict[str, Array]:
    """Return the parameters of n motors, each (n,); a motor is the same in a small ensemble and in a large one."""
    places = 2.0 * np.random.default_rng(seed).random((n, len(PARAMETERS))) - 1.0
    half = {each.name: each.half for each in tolerances}
    return {
        name: value + half.get(name, 0.0) * places[:, column]
        for column, (name, value) in enumerate(nominal_values(motor).items())
    }


def _tolerance(name: str, value: float, spread: object) -> Tolerance:
    half = _half_width(name, value, spread)
    what = f"spread: {name}={spread}"
    if not (math.isfinite(half) and half >= 0.0):
        raise UsageError(
            f"{what}: expected a tolerance of 0 or more, such as 10% or a half width with its unit"
        )
    if value - half < 0.0 or (value == half and name not in _MAY_BE_ZERO):
        raise UsageError(
            f"{what}: {with_unit(value, PARAMETERS[name])} less {with_unit(half, PARAMETERS[name])} is a value that no motor "
            f"has; expected {'at most' if name in _MAY_BE_ZERO else 'less than'} 100%"
        )
    if half == 0.0 and value == 0.0 and spread not in (0, 0.0):
        raise UsageError(
            f"{what}: the {parameter_in_words(name)} is 0, and so is any part of it; set it in the motor's settings first"
        )
    return Tolerance(name=name, value=value, half=half)


def _half_width(name: str, value: float, spread: object) -> float:
    if isinstance(spread, int | float) and not isinstance(spread, bool):
        return float(spread) * abs(value)
    if not isinstance(spread, str):
        raise UsageError(
            f"spread: {name} is {text_of_value(spread)}; expected a part of it such as 0.1, or a text such as '10%'"
        )
    try:
        if spread.rstrip().endswith("%"):
            return float(spread.rstrip()[:-1]) / 100 * abs(value)
        half = quantity(spread, PARAMETERS[name])
    except UnitError as error:
        raise UsageError(f"spread: {name}: {error}, or a percentage such as 10%") from None
    except ValueError:
        raise UsageError(f"spread: {name}={spread}: expected a number before the %, such as 10%") from None
    if _is_bare(spread):
        raise UsageError(
            f"spread: {name}={spread}: expected a percentage such as 10%, or a half width with its unit, such as "
            f"{with_unit(0.1 * value, PARAMETERS[name], 2)}"
        )
    return half


def _is_bare(text: str) -> bool:
    """Whether a text is a number without a unit."""
    try:
        float(text)
    except ValueError:
        return False
    return True

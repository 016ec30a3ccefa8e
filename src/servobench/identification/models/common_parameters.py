"""The parameters that several structures of a motor have."""

from __future__ import annotations

from servobench.identification.models.base import Parameter

GAIN = Parameter(name="gain", meaning="steady speed per unit of input", unit="{position}/(s·{input})")


TIME_CONSTANT = Parameter(
    name="time_constant", meaning="time in which a step covers 63.2 %", unit="s", lower=0.0
)


COULOMB = Parameter(
    name="coulomb_voltage",
    meaning="input needed to overcome friction, in either direction",
    unit="{input}",
    lower=0.0,
)


ONE_WAY = Parameter(
    name="coulomb_voltage",
    meaning="input needed to overcome friction and offset in this direction",
    unit="{input}",
)


OFFSET = Parameter(
    name="offset_voltage", meaning="input at which the motor produces no torque", unit="{input}"
)


DELAY = Parameter(name="delay", meaning="time from a change of the input to its effect", unit="s")

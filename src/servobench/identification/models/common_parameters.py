"""The parameters that several structures of a motor have."""

from __future__ import annotations

from servobench.identification.models.base import Parameter

GAIN = Parameter(name="gain", meaning="steady speed for each unit of input", unit="{position}/(s·{input})")


TIME_CONSTANT = Parameter(
    name="time_constant", meaning="time in which a step covers 63.2 %", unit="s", lower=0.0
)


COULOMB = Parameter(
    name="coulomb_voltage",
    meaning="input that friction takes, whichever way the motor turns",
    unit="{input}",
    lower=0.0,
)


ONE_WAY = Parameter(
    name="coulomb_voltage",
    meaning="input that friction and offset take while the motor turns this way",
    unit="{input}",
)


OFFSET = Parameter(name="offset_voltage", meaning="input at which the motor gets no torque", unit="{input}")


DELAY = Parameter(name="delay", meaning="time from a change of the input until it acts", unit="s")

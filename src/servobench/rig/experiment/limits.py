"""The limits of an experiment: those of the output, and those that end a run if something goes wrong."""

from __future__ import annotations

from typing import Annotated, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.settings import (
    Angle,
    Current,
    In,
    PositiveTime,
    PositiveVoltage,
    Resistance,
    Settings,
    Speed,
    Time,
    Voltage,
    none_for,
)

Light: TypeAlias = Literal["off", "red", "green", "blue"]
LIGHTS: dict[Light, tuple[float, float, float]] = {
    "off": (0.0, 0.0, 0.0),
    "red": (1.0, 0.0, 0.0),
    "green": (0.0, 1.0, 0.0),
    "blue": (0.0, 0.0, 1.0),
}
"""Red, green and blue of each light, 0 to 1."""

Slew: TypeAlias = Annotated[float, In("V/s"), Field(gt=0)]
Gain: TypeAlias = Annotated[float, In("rad/(s·V)"), Field(gt=0)]


LONGEST_TIMEOUT = 0.5  # s; an undriven motor runs on for that long


class Outputs(Settings):
    """A value for each output of a device."""

    voltage: Voltage = 0.0
    """Voltage [V]."""
    light: Light = "blue"
    """Light, where the device has one: off, red, green or blue."""


class Watchdog(Outputs):
    """The cut-off of a device that is no longer driven: after which time, and its output then."""

    timeout: Annotated[Time, Field(ge=0.02, le=LONGEST_TIMEOUT)] = 0.1
    """Longest time from one fresh actuation to the next: a voltage written after a new sample; 20 ms to 500 ms [s]."""
    light: Light = "red"
    """Light once it was cut off."""

    def check_sample_time(self, sample_time: float) -> None:
        """Raise `UsageError` for a sample time [s] above half of the timeout: a loop in real time needs two."""
        if not 2 * sample_time > self.timeout:
            return
        sentence = f"limits.watchdog.timeout is {self.timeout:g} s; expected at least two samples of {sample_time:g} s"
        if 2 * sample_time <= LONGEST_TIMEOUT:
            raise UsageError(
                f"{sentence}: raise it to {2 * sample_time:g} s, or use a sample time of at most {self.timeout / 2:g} s"
            )
        raise UsageError(
            f"{sentence}; it can't exceed {LONGEST_TIMEOUT:g} s, so use a sample time of at most "
            f"{LONGEST_TIMEOUT / 2:g} s in real time (at most {self.timeout / 2:g} s with this timeout)"
        )


class StallLimits(Settings):
    """The limits of a stall, with the semantics and numbers of Quanser's amplifiers: 5 V and 3 s."""

    voltage: PositiveVoltage = 5.0
    """Control threshold: it can be stalled where the voltage is larger than this, in either direction [V]."""
    motion: Annotated[Speed, Field(gt=0)] = 1.0
    """Motion threshold: it is stalled where it turns slower than this, in either direction [rad/s]."""
    warning: PositiveTime = 0.04
    """The time of a stall after which it is a warning [s]."""
    duration: PositiveTime = 3.0
    """The time of an unbroken stall after which it is a fault [s]."""


class Plausibility(Settings):
    """The motor that the encoder is compared with: a data sheet, or gain and time constant.

    Without either, the device's own data sheet is used, if it names one; otherwise nothing is compared.
    """

    motor: str = ""
    """Name of a data sheet."""
    gain: Gain | None = None
    """Gain, in place of the data sheet's [rad/(s·V)]."""
    time_constant: PositiveTime | None = None
    """Time constant, in place of the data sheet's [s]."""
    coulomb_voltage: Annotated[Voltage, Field(ge=0)] = 0.2
    """Voltage that friction takes; no data sheet has it [V]."""
    resistance: Annotated[Resistance, Field(gt=0)] | None = None
    """Winding resistance, in place of the data sheet's; it lets the current tell a blocked shaft from a dead encoder [Ω]."""
    voltage: PositiveVoltage = 2.0
    """Smallest voltage at which an encoder that stands still is suspect; with less, friction may hold the shaft [V]."""

    @model_validator(mode="after")
    def _leaves_something(self) -> Self:
        if (self.gain is None) != (self.time_constant is None):
            raise ValueError("has only one of gain and time_constant; give both, or the name of a data sheet")
        if self.coulomb_voltage >= self.voltage:
            raise ValueError(
                f"friction of {self.coulomb_voltage:g} V holds the shaft at {self.voltage:g} V; expected a voltage "
                "above coulomb_voltage"
            )
        return self


class Limits(Settings):
    """The limits of the output, the conditions that end a run, and the output values at start, end and fault.

    Voltage and slew are kept by clipping. Current, speed, travel, a stall, a step or a standstill of the encoder that no motor
    makes, and a loop that falls silent are faults: zero volts are put out, and the fault stays until it is acknowledged.
    """

    voltage: PositiveVoltage = 10.0
    """Largest voltage, in either direction; what is beyond is clipped [V]."""
    slew: Slew | None = None
    """Largest change of the voltage in a second; what is faster is clipped [V/s]."""
    current: Annotated[Current, Field(gt=0)] | None = None
    """Largest current, in either direction; more is a fault [A]."""
    speed: Annotated[Speed, Field(gt=0)] | None = None
    """Largest speed, in either direction; more is a fault [rad/s]."""
    travel: Annotated[Angle, Field(gt=0)] | None = None
    """Largest angle from where the shaft was at the start; more is a fault [rad]."""
    possible_speed: Annotated[Speed, Field(gt=0)] | None = None
    """Speed that the motor can't have: a larger step of the encoder is a fault of the encoder [rad/s]."""
    stall: Annotated[StallLimits | None, none_for("off")] = StallLimits()
    """When a shaft counts as stalled; None (in a file "off") never."""
    plausibility: Annotated[Plausibility | None, none_for("off")] = Plausibility()
    """The motor that the encoder is compared with; None (in a file "off") for nothing."""
    start: Outputs = Outputs()
    """The voltage from the first sample's time until the run's first voltage; before that 0 V."""
    terminate: Outputs = Outputs()
    """The voltage while a fault is latched, and the last one before the device is stopped."""
    watchdog: Watchdog = Watchdog()
    """The cut-off of a device that is no longer driven: after which time, and its output then."""
    driven_light: Light = "green"
    """Light while voltages are written."""
    fault_light: Light = "red"
    """Light while a fault is latched."""

    def start_voltage(self, sample_time: float) -> float:
        """Return the start value as far as the slew limit lets it go from 0 V in one sample [V]."""
        most = self.voltage if self.slew is None else self.slew * sample_time
        return min(max(self.start.voltage, -most), most)

    def findings(self) -> tuple[Finding, ...]:
        """Return the findings about limits that drive a motor without a loop, or switch the stall monitor off."""
        findings = []
        if self.start.voltage:
            findings.append(
                warning(
                    "voltage-at-start",
                    f"{self.start.voltage:g} V are applied before the run starts (limits.start.voltage), so the "
                    "motor may turn at once. Use 0 V, unless it must hold a load.",
                )
            )
        for name in ("terminate", "watchdog"):
            value = getattr(self, name).voltage
            if value:
                findings.append(
                    warning(
                        "voltage-after-fault",
                        f"After a fault {value:g} V stay on the motor (limits.{name}.voltage), so it may keep "
                        "turning. Use 0 V, unless it must hold a load.",
                    )
                )
        if self.stall is None:
            findings.append(
                info("stall-not-watched", "A blocked shaft isn't detected: the winding may overheat.")
            )
        return tuple(findings)

    @model_validator(mode="after")
    def _outputs_within(self) -> Self:
        for name in ("start", "terminate", "watchdog"):
            value = getattr(self, name).voltage
            if abs(value) > self.voltage:
                raise ValueError(
                    f"{name}.voltage is {value:g} V, beyond the limit of {self.voltage:g} V; expected one within it"
                )
        return self

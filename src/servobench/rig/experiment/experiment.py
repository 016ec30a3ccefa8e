"""An experiment: the plan of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Self, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from servobench.core.finding import Finding, info, warning
from servobench.core.settings import MemberOf, PositiveTime, Settings, none_for, with_units
from servobench.core.toml import table_lines
from servobench.rig.clock import Missed, Phase
from servobench.rig.experiment.limits import Limits
from servobench.systems.control.base import CONTROLLERS, Controller
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.signals.base import AnySignal
from servobench.systems.signals.square import Square

AnyController: TypeAlias = Annotated[Controller, MemberOf(CONTROLLERS)]
_MOST_EVALUATED = 200_000  # ticks of a signal that `findings` looks at; 400 s at 500 Hz


def _writable(value: Any) -> Any:
    """Return a copy of a value that a TOML file can hold; raises ValueError for any other."""
    if isinstance(value, bool | int) or (isinstance(value, float) and not math.isnan(value)):
        return value
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError as error:
            raise ValueError(
                f"character {error.start + 1} is half a surrogate pair, which can't be stored in a file"
            ) from None
        return value
    if isinstance(value, list | tuple):
        return [_writable(item) for item in value]
    if isinstance(value, Mapping) and all(isinstance(key, str) for key in value):
        return {_writable(key): _writable(item) for key, item in value.items()}
    raise ValueError(
        f"{value!r} can't be a setting; expected a text, a number, true or false, or an array or table of these"
    )


def _name_fault(table: Mapping[str, Any]) -> Any:
    """Return a fault's table as a file can hold it; raises ValueError for one without a name."""
    if not (isinstance(table.get("name"), str) and table["name"]):
        raise ValueError('has no name; expected name = "..." (see `servobench faults`)')
    return _writable(table)


Text: TypeAlias = Annotated[str, AfterValidator(_writable)]
Duration: TypeAlias = Annotated[PositiveTime | None, none_for("endless")]
Seed: TypeAlias = Annotated[Annotated[int, Field(ge=0, strict=True)] | None, none_for("random")]


class DeviceChoice(Settings):
    """The device, and its settings as they stand in the file; the device's own settings model checks them."""

    name: Annotated[str, Field(min_length=1), AfterValidator(_writable)] = "twin"
    """Name of the device."""
    settings: Annotated[Mapping[str, Any], AfterValidator(_writable)] = Field(default_factory=dict)
    """Settings of that device."""
    faults: tuple[Annotated[Mapping[str, Any], AfterValidator(_name_fault)], ...] = ()
    """Faults to inject, each with its name and its settings; the faults' own models check them."""


class WhenLate(Settings):
    """The policy for missed ticks when the host keeps the time; `HostClock` has the exact rules."""

    missed: Missed = "discard"
    """Leave whole ticks that have gone by out ("discard"), or do them late ("process")."""
    phase: Phase = "keep"
    """Go back to the schedule after a late tick ("keep"), or restart the schedule from it ("lose")."""


class Experiment(Settings):
    """An experiment to run: a signal, a controller, a device, the duration and the sample time.

    Tick k is at k · sample_time, k from 0 to `samples` - 1. Without any argument it is a square wave of 1 to 3 V and 0.4 Hz for
    10 s at 500 Hz, in open loop, on the simulated QUBE-Servo.

    >>> from servobench import Step
    >>> Experiment(signal=Step(final="2 V"), duration="500 ms", sample_time="5 ms").samples
    100
    """

    name: Text = ""
    """A short name for people."""
    notes: Text = ""
    """Anything worth knowing later."""
    signal: AnySignal = Square(low=1, high=3, frequency=0.4)
    """The controller's reference, in its unit (rad, rad/s); in open loop the voltage [V]."""
    duration: Duration = 10.0
    """The duration, or None (in a file "endless"): until it's stopped [s]."""
    sample_time: PositiveTime = 0.002
    """Time between two ticks [s]."""
    controller: AnyController = OpenLoop()
    """The law from reference and sample to voltage."""
    device: DeviceChoice = DeviceChoice()
    """The device to run it on."""
    limits: Limits = Limits()
    """The limits of the output, and the conditions that end a run."""
    when_late: WhenLate = WhenLate()
    """The policy for missed ticks."""
    seed: Seed = 0
    """Seed of simulated noise; None (in a file "random") takes another one for each run."""
    chain: Text = ""
    """Measurement chain through which the recording is to be examined, such as `derivative | lowpass 50 rad/s`."""
    nominal: Text = ""
    """Name of the data sheet that the result is compared with."""
    until: Text = ""
    """Interval at which the run ends before its time, such as `time_constant=0.5%` (half of the 95 % interval)."""

    @model_validator(mode="after")
    def _has_two_samples(self) -> Self:
        if self.duration is not None and self.samples is not None and self.samples < 2:
            raise ValueError(
                f"a duration of {self.duration:g} s holds fewer than two samples, {self.sample_time:g} s apart; "
                "expected a longer duration or a shorter sample time"
            )
        return self

    @property
    def sample_rate(self) -> float:
        """Ticks in a second [Hz]."""
        return 1 / self.sample_time

    @property
    def samples(self) -> int | None:
        """The number of ticks before the duration is over; None where it is endless."""
        if self.duration is None:
            return None
        ticks = self.duration / self.sample_time
        # A tick that misses the end by a rounding error falls on it, and belongs to the experiment no more.
        return math.ceil(ticks - 1e-9 - 4 * np.finfo(float).eps * ticks)

    def findings(self) -> tuple[Finding, ...]:
        """Return what is worth knowing before the experiment is run; it can be run all the same."""
        return tuple(
            finding
            for finding in (*self._pace_findings(), *self._level_findings(), *self.limits.findings())
            if finding
        )

    def to_toml(self) -> str:
        """Return the experiment as the text of a TOML file, which reads back as an equal experiment."""

        return to_toml(self)

    def _pace_findings(self) -> tuple[Finding | None, ...]:
        """Findings on the signal's speed and duration."""
        shortest, period = self.signal.shortest_change, self.signal.period
        too_fast = part = None
        if shortest is not None and shortest < self.sample_time * (1 - 1e-9):
            too_fast = warning(
                "signal-too-fast",
                f"The signal changes within {shortest:g} s, faster than the sample time of {self.sample_time:g} s, "
                "so the device can't follow it. Use a shorter sample time or a slower signal.",
            )
        if period is not None and self.duration is not None and self.duration < period * (1 - 1e-9):
            part = info(
                "part-of-a-period",
                f"The signal repeats after {period:g} s, but the experiment ends after {self.duration:g} s.",
            )
        return too_fast, part

    def _level_findings(self) -> tuple[Finding | None, ...]:
        """Findings on the signal's values, if they are the voltage."""
        if not isinstance(self.controller, OpenLoop):
            return ()
        ticks = np.arange(min(self.samples or _MOST_EVALUATED, _MOST_EVALUATED), dtype=np.float64)
        t = ticks * self.sample_time
        u = self.signal(t)
        largest = int(np.argmax(np.abs(u)))
        clipped = still = slewed = None
        if abs(u[largest]) > self.limits.voltage:
            clipped = warning(
                "signal-above-limit",
                f"The signal reaches {u[largest]:g} V, for example at {t[largest]:g} s; it is clipped at the limit "
                f"of {self.limits.voltage:g} V.",
            )
        if u[largest] == 0:
            still = warning(
                "signal-is-zero", f"The signal is 0 V from the start to {t[-1]:g} s: nothing will move."
            )
        slew = self.limits.slew
        steepest = float(np.abs(np.diff(u, prepend=self.limits.start.voltage)).max()) / self.sample_time
        if slew is not None and steepest > slew * (1 + 1e-9):
            slewed = warning(
                "signal-above-slew",
                f"The signal changes by up to {steepest:g} V/s from one sample to the next; it is limited to "
                f"{slew:g} V/s.",
            )
        return clipped, still, slewed


PAPER = Experiment(
    name="paper",
    notes="A square wave of 1 to 3 V at 0.4 Hz for 10 s, sampled at 500 Hz: the speed exercise with the QUBE-Servo.",
)
"""The experiment that is run where none is named."""


_TABLES = ("signal", "controller", "device", "limits", "when_late")


def to_toml(experiment: Experiment) -> str:
    """Return an experiment as the text of a TOML file: everything spelled out, each quantity with its unit."""
    entries = with_units(experiment)
    # A signal's levels are volts where it is the voltage; otherwise they are what the controller follows.
    entries["signal"] = with_units(experiment, {"V": experiment.controller.reference_unit})["signal"]
    fields = {name: value for name, value in entries.items() if name not in _TABLES and value != ""}
    fields.setdefault("duration", "endless")
    fields.setdefault("seed", "random")
    for monitor in ("stall", "plausibility"):
        entries["limits"].setdefault(monitor, "off")
    for name in ("settings", "faults"):
        if not entries["device"][name]:
            del entries["device"][name]
    tables = {"experiment": fields, **{name: entries[name] for name in _TABLES}}
    lines = ["# An experiment for servobench. A number without a unit is in SI units."]
    for name, table in tables.items():
        lines += table_lines((name,), table)
    return "\n".join(lines) + "\n"

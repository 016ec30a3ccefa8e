"""The kind `faults`: what can go wrong with a device, injected on purpose."""

from __future__ import annotations

import math
import shlex
import tomllib
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np
from pydantic import ConfigDict, Field, ValidationError, model_validator

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.errors import UsageError
from servobench.core.registry import Registry
from servobench.core.settings import PositiveTime, Settings, Time, problems_text, with_units
from servobench.rig.devices.base import Device

Latch = Callable[[], Sample]
Put = Callable[[float], float]

# Times that ought to be equal differ by rounding; a millionth of a sample time is far below what anybody can mean.
_SAME_TIME = 1e-6


@runtime_checkable
class Simulated(Protocol):
    """Optional methods of a simulated motor, with which it can be disturbed where a real one can't."""

    def read_after(self, delay: float) -> Sample:
        """Latch the next sample some time [s] after its tick; in virtual time only."""
        ...

    def block(self, blocked: bool) -> None:
        """Hold the shaft where it is, from now on, or let it go."""
        ...


class Injected(Protocol):
    """A run with faults, as each of them sees it."""

    device: Device
    """The device itself, without any fault."""
    sample_time: float
    """The run's sample time [s]."""
    random: np.random.Generator
    """Chance, for this fault alone."""

    @property
    def now(self) -> float:
        """The undisturbed time of the device's last sample, counted from its first [s]."""
        ...

    @property
    def due(self) -> float:
        """The same of its next sample [s]."""
        ...

    def hold_up(self, delay: float) -> None:
        """Let the device's next latch be late by that time [s]."""
        ...


def straight_through(latch: Latch) -> Sample:
    """Read, and change nothing."""
    return latch()


def write_unchanged(voltage: float, put: Put) -> float:
    """Write a voltage [V], and change nothing."""
    return put(voltage)


@dataclass(frozen=True, kw_only=True)
class Injection:
    """A fault at work in one run: what it makes of a read, and of a write [V]."""

    read: Callable[[Latch], Sample] = straight_through
    write: Callable[[float, Put], float] = write_unchanged


class Fault(Settings, ABC):
    """Base of all faults: settings with units, the devices that can have it, and what it does in a run.

    Times are the device's own, counted from its first sample; a fault begins and ends at samples.
    """

    model_config = ConfigDict(populate_by_name=True)

    sees_every_sample: ClassVar[bool] = True
    """Whether it has to see all samples, to know what to make of those of its time."""

    def next_time(self, run: Injected) -> float:
        """Return the time of the next sample that it has to see [s], on the run's own clock; infinite where there is none."""
        return run.due

    def unsupported(self, device: Device) -> str | None:
        """Return what keeps a device from having this fault, as the end of a sentence; None where nothing does."""
        return None

    def info_shown(self, info: DeviceInfo) -> DeviceInfo:
        """Return what a device with this fault says of itself."""
        return info

    @abstractmethod
    def begin(self, run: Injected) -> Injection:
        """Return the fault at work in a run that begins; raises `UsageError` where its sample time doesn't allow it."""


class Lasting(Fault, ABC):
    """A fault that is there for a time."""

    from_: Annotated[Time, Field(ge=0)] = Field(default=0.0, alias="from")
    """When it begins, counted from the first sample [s]."""
    for_: PositiveTime | None = Field(default=None, alias="for")
    """The duration; without it, to the end [s]."""

    def next_time(self, run: Injected) -> float:
        """Return the beginning where that is to come [s]; after its end it has nothing more to see."""
        if self.sees_every_sample or self.holds(run) or self.will_hold(run):
            return run.due
        return self.from_ if run.due < self.from_ else math.inf

    def holds(self, run: Injected) -> bool:
        """Whether the device's last sample lies in that time: from its beginning on, and before its end."""
        return self._covers(run.now, run.sample_time)

    def will_hold(self, run: Injected) -> bool:
        """The same of its next sample."""
        return self._covers(run.due, run.sample_time)

    def _covers(self, time: float, sample_time: float) -> bool:
        after = time + _SAME_TIME * sample_time
        return after >= self.from_ and (self.for_ is None or after < self.from_ + self.for_)


class Final(Fault, ABC):
    """A fault from which there is no way back within the run."""

    from_: Annotated[Time, Field(ge=0)] = Field(default=1.0, alias="from")
    """When it happens, counted from the first sample [s]."""

    def next_time(self, run: Injected) -> float:
        """Return when it happens [s]."""
        return run.due if self.sees_every_sample else max(self.from_, run.due)

    def is_due(self, run: Injected) -> bool:
        """Whether the device's last sample is at that time or after it."""
        return run.now >= self.from_ - _SAME_TIME * run.sample_time


class Occasional(Lasting, ABC):
    """A fault of single samples, within a time."""

    every: Annotated[int, Field(ge=1)] | None = None
    """Each how many samples of that time it happens; without it, and without a probability, at each."""
    probability: Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)] | None = None
    """The probability at each sample of that time, from 0 to 1."""

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if self.every is not None and self.probability is not None:
            raise ValueError("has both every and probability; leave one of them out")
        return self

    def occasions(self, run: Injected) -> Callable[[bool], bool]:
        """Return a function that says, for each sample in turn, whether the fault happens; it takes whether the time is right."""
        passed = 0

        def happens(holds: bool) -> bool:
            nonlocal passed
            if not holds:
                return False
            passed += 1
            if self.probability is not None:
                return bool(run.random.random() < self.probability)
            return passed % (self.every or 1) == 0

        return happens


FAULTS: Registry[type[Fault]] = Registry(
    "fault", "servobench.rig.devices.faults", "servobench.devices.faults"
)


def fault_from(table: Mapping[str, Any]) -> Fault:
    """Return the fault that a table describes: its `name`, and its settings.

    Raises `UnknownName`, which lists the faults, and pydantic's `ValidationError` for settings that it hasn't or can't have.
    """
    settings = {key: value for key, value in table.items() if key != "name"}
    return FAULTS[str(table["name"])].model_validate(settings)


def table_of(text: str) -> dict[str, Any]:
    """Return the table that a text such as `stuck_channel from=2s for=100ms` stands for.

    Raises `UsageError` where it is none, or describes no fault.
    """
    try:
        name, *settings = shlex.split(text)
    except ValueError:
        why = "a quotation mark isn't closed" if text.strip() else "it is empty"
        raise UsageError(
            f"the fault {text!r} can't be read ({why}); expected a name and settings: stuck_channel from=2s for=100ms"
        ) from None
    table: dict[str, Any] = {"name": name}
    for setting in settings:
        key, sign, value = setting.partition("=")
        if not (key and sign and value) or key in table:
            raise UsageError(
                f"the fault {text!r}: {setting!r} isn't a setting, or occurs twice; expected key=value, as in from=2s"
            )
        table[key] = _value(value)
    try:
        fault_from(table)
    except ValidationError as error:
        raise UsageError(f"the fault {text!r}: {problems_text(error)}") from None
    return table


def text_of(fault: Fault) -> str:
    """Return a fault as a text that reads back the same: its name, and the settings that aren't the defaults."""
    fields = type(fault).model_fields
    settings = {
        fields[name].alias or name: value
        for name, value in with_units(fault).items()
        if getattr(fault, name) != fields[name].default
    }
    return shlex.join(
        [FAULTS.name_of(fault), *(f"{key}={value}".replace(" ", "") for key, value in settings.items())]
    )


def _value(text: str) -> Any:
    """A number, true or false where the text is one, as in a file, otherwise the text."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text

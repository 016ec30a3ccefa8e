"""The kind `devices`: each turns a voltage into motion, and counts it.

A member is a class that `DEVICES.member(name)` decorates; `info.name` is that name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from types import TracebackType
from typing import Any, ClassVar, Protocol, Self, runtime_checkable

import numpy as np

from servobench.core.arguments import check_type
from servobench.core.channels import Array, DeviceInfo, Sample
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, lower_first
from servobench.core.registry import Registry
from servobench.recordings.recording import Stopped
from servobench.systems.control.base import Controller


class RunEnded(Exception):
    """A device's word that its run is over: a recording played to its end, a motor that a guard has stopped.

    It is a result and no error, so it stands outside of their tree: a run that gets it stops the motor and ends with `stopped`.
    `sample` is the last one to be recorded, where the reason stands in it.
    """

    def __init__(self, stopped: Stopped, sample: Sample | None = None) -> None:
        super().__init__(stopped.sentence)
        self.stopped = stopped
        self.sample = sample


@runtime_checkable
class Device(Protocol):
    """A motor, simulated or real; a context manager: entering connects at zero volts, leaving stops and closes.

    Each tick of a run is one `read` and then one `write`, all by one thread. Where a call doesn't return in time, other threads
    call `write` with 0 V and `stop` beside it, as a motor that runs on is worse than two calls at once; a device that can't bear
    that raises an error then. Any method but `stop` may raise `DeviceError`; outside of a `with` statement `start`, `read` and
    `write` do, and say so. A device that moves nothing has a class variable `drives` that is False.
    """

    Settings: ClassVar[type[Any]]
    """The pydantic model of its settings."""

    def __init__(self, settings: Any) -> None: ...

    @property
    def info(self) -> DeviceInfo:
        """The device's description, also before it is connected; it has the channels `voltage` and `counts` at least."""
        ...

    def __enter__(self) -> Self:
        """Connect; the motor is at zero volts."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the motor and close the connection."""
        ...

    def start(self, sample_time: float, seed: int | None) -> None:
        """Prepare a run with that sample time [s]; the motor is at rest; a seed makes simulated noise repeatable.

        May be called again for another run. Raises `UsageError` for a sample time that isn't finite and above 0.
        """
        ...

    def read(self) -> Sample:
        """Latch and return the inputs at t_k; waits for the tick where the device is its own time base.

        The first sample of a run has the index 0. Raises `RunEnded` where there is nothing more to come, `UsageError` before
        `start`.
        """
        ...

    def write(self, voltage: float) -> float:
        """Hold a finite voltage [V] from t_k (+ `info.delay`) to t_k+1 and return the voltage that the device puts out.

        The two differ where the device limits. Never sleeps. Raises `UsageError` for a voltage that isn't finite.
        """
        ...

    def stop(self) -> None:
        """Put the motor into its safe state, zero volts; may be called twice, and by any thread; never raises."""
        ...


@runtime_checkable
class Lit(Protocol):
    """Optional methods of a device with a light; a guard shows by it whether the motor is driven or has failed."""

    def light(self, red: float, green: float, blue: float) -> None:
        """Light the lamp in that colour, each part from 0 to 1."""
        ...


@runtime_checkable
class Preloaded(Protocol):
    """Optional methods of a device that puts voltages out by its own clock; a run hands over all of them if it knows them."""

    def preload(self, voltages: Array) -> None:
        """Take the voltages (N,) [V] of the next run in advance; its writes may differ, and go before; changes `info`."""
        ...


@runtime_checkable
class Restarting(Protocol):
    """An optional property of a device that starts anew while it is being opened, and doesn't answer meanwhile."""

    @property
    def opening_time(self) -> float:
        """The time for which no answer is normal then [s]."""
        ...


@runtime_checkable
class SelfStopping(Protocol):
    """An optional property of a device that lets the motor go by itself if no voltage comes any more."""

    @property
    def own_watchdog(self) -> float | None:
        """The time for which it waits for a voltage [s]; None if it waits without end."""
        ...


@runtime_checkable
class Reporting(Protocol):
    """An optional method of a device that has something to say of a run beside its samples."""

    def findings(self) -> tuple[Finding, ...]:
        """Return what is worth knowing of the run so far, such as that its own watchdog ended it."""
        ...


@runtime_checkable
class Following(Protocol):
    """Optional methods of a device that computes a law by itself; a run gives it that of its experiment."""

    def take_law(self, law: Controller | None, sample_time: float, limit: float) -> bool:
        """Take the law of the next run, at samples `sample_time` [s] apart and within ±`limit` [V]; None for none.

        Returns whether the device will compute it, which changes `info`; where it can't, its writes are what is put out. `pi`
        is made for this.
        """
        ...

    def follow(self, reference: float) -> float:
        """Let the law follow a reference [rad or rad/s], and return the voltage that it put out with the last sample [V].

        A `write` of that voltage leaves the law as it is; of any other one it ends the law.
        """
        ...


def voltage_or_nan(voltage: object) -> float:
    """Return what is given as a voltage [V] as a float, NaN where it is no number; infinities stay."""
    if type(voltage) is float:
        return voltage
    value = math.nan
    if isinstance(voltage, int | float | np.floating | np.integer) and not isinstance(voltage, bool):
        with suppress(OverflowError):  # an integer of hundreds of digits
            value = float(voltage)
    return value


def value_text(value: object) -> str:
    """Return a value for a sentence: as Python shows it, in one line that is cut short, with its type unless that is float."""
    kind = type(value)
    if isinstance(value, float | np.floating):
        return repr(float(value))
    try:
        shown = " ".join(repr(value).split())
    except Exception:  # a custom __repr__, or an integer too long to be printed
        shown = "a value"
    shown = shown if len(shown) <= 40 else f"{shown[:37]}..."
    name = kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"
    return shown if value is None else f"{shown} (of type {name[:40]})"


def error_text(error: BaseException) -> str:
    """Return an error that a device's call raised, for a sentence: as Python shows it, a request to end in words."""
    if isinstance(error, KeyboardInterrupt):
        return f"the call was interrupted by {error.args[0] if error.args else 'Ctrl-C'}"
    return repr(error)


def finite_voltage(device: str, voltage: object) -> float:
    """Return a voltage [V] as the float that a device of that name may act on; raises `UsageError` for anything else."""
    # No comparison with a limit catches NaN: min(max(nan, -15), 15) is 15 or NaN, by the order of the arguments.
    value = voltage_or_nan(voltage)
    if not math.isfinite(value):
        raise UsageError(f"{device}: {value_text(voltage)} isn't a voltage; expected a finite number in V")
    return value


DEVICES: Registry[type[Device]] = Registry("device", "servobench.rig.devices", "servobench.devices")


def connect(name: str, **settings: object) -> Device:
    """Return the device of that name, for use in a `with` statement.

    `settings` are the device's own, numbers in SI units or texts with a unit: `connect("twin", coulomb_torque="0.8 mN·m")`.
    Raises `UnknownName`, which lists the devices, and `UsageError` for unknown or invalid settings.

    >>> with connect("twin", disc_inertia="40 g*cm^2") as motor:
    ...     print(motor.info.name)
    twin
    """
    check_type("name", name, str, 'the name of a device, such as "twin"')
    device = DEVICES[name]
    if missing := missing_settings(name, settings):
        raise UsageError("\n".join(f"{name}: {each}" for each in missing))
    from pydantic import ValidationError

    from servobench.core.settings import problems_text

    try:
        return device(device.Settings.model_validate(settings))
    except ValidationError as error:
        raise UsageError(f"{name}: {problems_text(error)}") from None


def missing_settings(name: str, settings: Mapping[str, object]) -> tuple[str, ...]:
    """Return a sentence for each required setting that is missing: its name, and what it is.

    Raises `UnknownName`, which lists the devices.
    """
    return tuple(
        f"its setting {key!r} is missing: {lower_first(field.description or 'servobench devices lists them').rstrip('.')}"
        for key, field in DEVICES[name].Settings.model_fields.items()
        if field.is_required() and key not in settings
    )

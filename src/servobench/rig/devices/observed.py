"""A device with observed calls: which one is under way, and whether the last voltage was zero."""

from __future__ import annotations

import threading
from enum import IntEnum
from types import TracebackType
from typing import Any, ClassVar, Protocol, Self

from servobench.core.channels import DeviceInfo, Sample
from servobench.rig.devices.base import Device, voltage_or_nan


class Call(IntEnum):
    """The activity of the thread that drives a device: one of the device's calls, or the work between two ticks' calls."""

    NONE = 0
    OPEN = 1
    START = 2
    READ = 3
    WRITE = 4
    STOP = 5
    CLOSE = 6
    BETWEEN = 7


class Observer(Protocol):
    """An observer of a device's calls. Each tick waits for it, so it must be quick; it never raises."""

    def began(self, call: Call) -> None:
        """Take note of a call that the driving thread begins."""
        ...

    def note_return(self, call: Call) -> None:
        """Take note that this call of the driving thread has returned, or raised."""
        ...

    def output(self, is_zero: bool) -> None:
        """Take note of what the device's output is known to be: zero volts, or not known to be zero. Any thread may call it."""
        ...


class Observed:
    """A device around a device, which tells an observer about each call.

    Zero volts are known only where `stop`, or a `write` of 0 V that the device answers with 0 V (to half of its resolution), has
    returned, and no other voltage was begun or returned since. The calls of the thread that made this object are told; other
    threads may call `write` and `stop` in an emergency, which changes what is known of the output only.
    """

    Settings: ClassVar[type[Any]] = object

    def __init__(self, device: Device, observer: Observer) -> None:
        self.device = device
        self._observer = observer
        self._driver = threading.get_ident()
        channel = device.info.channel("voltage")
        self._exact = max((channel.resolution or 0.0) / 2 if channel else 0.0, 1e-9)

    @property
    def info(self) -> DeviceInfo:
        """The inner device's description."""
        return self.device.info

    def __getattr__(self, name: str) -> Any:
        """Optional methods, such as that of a light, are those of the inner device."""
        if name == "device":  # a copy that has none yet would recurse without end
            raise AttributeError(name)
        return getattr(self.device, name)

    def __enter__(self) -> Self:
        """Connect."""
        self._observer.began(Call.OPEN)
        try:
            self.device.__enter__()
        finally:
            self._observer.note_return(Call.OPEN)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop and close."""
        self._observer.began(Call.CLOSE)
        try:
            self.device.__exit__(kind, error, trace)
        finally:
            self._observer.note_return(Call.CLOSE)

    def start(self, sample_time: float, seed: int | None) -> None:
        """Prepare a run."""
        self._observer.began(Call.START)
        try:
            self.device.start(sample_time, seed)
        finally:
            self._observer.note_return(Call.START)

    def read(self) -> Sample:
        """Return the device's next sample."""
        self._observer.began(Call.READ)
        try:
            return self.device.read()
        finally:
            self._observer.note_return(Call.READ)

    def write(self, voltage: float) -> float:
        """Hand the voltage [V] on, and return the device's answer."""
        driving = threading.get_ident() == self._driver
        if driving:
            self._observer.began(Call.WRITE)
        if voltage != 0.0:
            self._observer.output(False)  # from here on it may be there
        try:
            applied = self.device.write(voltage)
            # Also where another thread has written zero volts meanwhile: this voltage came after them.
            self._observer.output(voltage == 0.0 and abs(voltage_or_nan(applied)) <= self._exact)
            return applied
        finally:
            if driving:
                self._observer.note_return(Call.WRITE)

    def stop(self) -> None:
        """Stop the device."""
        driving = threading.get_ident() == self._driver
        if driving:
            self._observer.began(Call.STOP)
        try:
            self.device.stop()
            self._observer.output(True)
        finally:
            if driving:
                self._observer.note_return(Call.STOP)

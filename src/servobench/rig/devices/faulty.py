"""A device with injected faults, to test an experiment, a guard or a lesson."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import Any, ClassVar, Self

import numpy as np

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, warning
from servobench.rig.devices import handover as at
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import (
    FAULTS,
    Fault,
    Injection,
    Latch,
    Put,
    Simulated,
    fault_from,
    text_of,
)
from servobench.rig.devices.handover import Handing, Handover, handover_part

SETTING = "faults"  # of a device's info, which lists the faults


class Faulty:
    """A device around a device that injects faults into what is read and written; otherwise it is the device itself.

    `faults` act in their order, the first nearest to the motor. They are requested by name, never there by themselves, and told
    in the info's settings, in the recording's findings and in the report. `seed` is that of their chance; without one they take
    the run's. `sleep` waits for some time [s]; a test may count instead. `stop` always reaches the device.
    Raises `UsageError`, before anything moves, where the device can't have one of the faults.
    """

    Settings: ClassVar[type[Any]] = Fault

    def __init__(
        self,
        device: Device,
        faults: Sequence[Fault],
        seed: int | None = None,
        *,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        self.device = device
        self._faults = tuple(faults)
        self._seed = seed
        self._sleep = sleep
        self._read: Latch = device.read
        self._write: Put = device.write
        self._runs: list[_Run] = []
        for fault in self._faults:
            _check(fault, device)

    @property
    def info(self) -> DeviceInfo:
        """The device's description, with the faults among its settings."""
        info = self.device.info
        for fault in self._faults:
            info = fault.info_shown(info)
        if not self._faults:
            return info
        faults = "; ".join(map(text_of, self._faults))
        return replace(info, settings=(*info.settings, (SETTING, faults)))

    def __getattr__(self, name: str) -> Any:
        """Optional methods, such as that of a light, are those of the inner device."""
        if name == "device":  # a copy that has none yet would recurse without end
            raise AttributeError(name)
        return getattr(self.device, name)

    def __enter__(self) -> Self:
        """Connect."""
        self.device.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop and close."""
        self.device.__exit__(kind, error, trace)

    @property
    def in_blocks(self) -> Handing | None:
        """The device itself, where no fault has to see samples before its time and the device within is able to."""
        able = type(self) is Faulty and handover_part(self.device) is not None
        return self if able and not any(fault.sees_every_sample for fault in self._faults) else None

    def hand_over(self, to: Handover) -> None:
        """Write what the device within does, and the tick before that of the next sample that a fault has to see."""
        inner = handover_part(self.device)
        if inner is not None:
            inner.hand_over(to)
        for fault, run in zip(self._faults, self._runs, strict=True):
            ticks = fault.next_time(run) / run.sample_time
            to.until = min(to.until, math.floor(ticks) - 1 if ticks < at.NEVER else at.NEVER)

    def take_back(self, block: Handover) -> None:
        """Read what the device within does, and the time."""
        inner = handover_part(self.device)
        if inner is not None:
            inner.take_back(block)
        for run in self._runs:
            run.pass_to(int(block.s[at.INDEX]))

    def start(self, sample_time: float, seed: int | None) -> None:
        """Prepare a run with that sample time [s]; each fault is reset."""
        if not (math.isfinite(sample_time) and sample_time > 0):
            self.device.start(sample_time, seed)  # which says what is wrong with it
        chance = seed if self._seed is None else self._seed
        source = _Source(self.device, sample_time, self._sleep)
        read: Latch = source.read
        write: Put = self.device.write
        self._runs = []
        for place, fault in enumerate(self._faults):
            # Each has its own chance, so that none changes what another does.
            random = np.random.default_rng(None if chance is None else (chance, place))
            self._runs.append(_Run(source, random))
            injection = fault.begin(self._runs[-1])
            read, write = partial(injection.read, read), partial(_write_voltage, injection, write)
        self.device.start(sample_time, seed)
        self._read, self._write = read, write

    def read(self) -> Sample:
        """Return the device's next sample with its faults."""
        return self._read()

    def write(self, voltage: float) -> float:
        """Pass the voltage [V] on, and return the device's answer with its faults."""
        return self._write(voltage)

    def stop(self) -> None:
        """Stop the device, whatever is wrong with it."""
        self.device.stop()


def with_faults(device: Device, tables: Sequence[Mapping[str, Any]]) -> Device:
    """Return a device with the faults that an experiment asks for, or the device itself where it asks for none.

    Raises `UnknownName`, pydantic's `ValidationError` and `UsageError` where one of them can't be had.
    """
    return Faulty(device, [fault_from(table) for table in tables]) if tables else device


def injection_findings(info: DeviceInfo | None) -> tuple[Finding, ...]:
    """Return the finding that faults were injected, by what a device says of itself; empty where there were none."""
    faults = dict(info.settings).get(SETTING) if info else None
    if not faults:
        return ()
    sentence = (
        f"Faults were injected on purpose: {faults}. They may explain anything odd in this recording; run the "
        "experiment without them before you trust a result."
    )
    return (warning("faults-injected", sentence),)


class _Source:
    """The device's own samples, and the time at which a run with faults is."""

    def __init__(self, device: Device, sample_time: float, sleep: Callable[[float], object]) -> None:
        self.device = device
        self.sample_time = sample_time
        self._sleep = sleep
        self._by_host = device.info.timing == "host"
        self._first: Sample | None = None
        self._delay = 0.0
        self.now = -sample_time

    def hold_up(self, delay: float) -> None:
        self._delay += delay

    def read(self) -> Sample:
        delay, self._delay = self._delay, 0.0
        sample = self._latch(delay) if delay > 0 else self.device.read()
        if self._first is None:
            self._first = sample
        # By the samples' numbers, as their times may scatter; a host counts reads, so that there it is the time.
        number = sample.index - self._first.index
        self.now = sample.time - self._first.time if self._by_host else number * self.sample_time
        return sample

    def _latch(self, delay: float) -> Sample:
        """The sample that a read gets which takes that long; where time is computed, the ticks in between go by."""
        if self._by_host or not isinstance(self.device, Simulated):
            self._sleep(delay)
            return self.device.read()
        # 3 ms are a tick and a half of 2 ms; what is a whole number of ticks but for rounding is that number.
        missed = math.floor(delay / self.sample_time * (1 + 1e-12))
        for _ in range(missed):
            self.device.read()
        return self.device.read_after(max(0.0, delay - missed * self.sample_time))


class _Run:
    """A run with faults, as one of them sees it."""

    def __init__(self, source: _Source, random: np.random.Generator) -> None:
        self._source = source
        self.device = source.device
        self.sample_time = source.sample_time
        self.random = random
        self.hold_up = source.hold_up

    @property
    def now(self) -> float:
        return self._source.now

    @property
    def due(self) -> float:
        return self._source.now + self.sample_time

    def pass_to(self, index: int) -> None:
        """Go on to the sample of that number, which somebody else took."""
        self._source.now = index * self.sample_time


def _write_voltage(injection: Injection, put: Put, voltage: float) -> float:
    return injection.write(voltage, put)


def _check(fault: Fault, device: Device) -> None:
    """Raise `UsageError` where a device can't have a fault; the message lists those that it can have."""
    reason = fault.unsupported(device)
    if reason is None:
        return
    # Of a fault with settings that have to be given, what is requested stands for it: only its kind matters here.
    able = [name for name in FAULTS.names() if FAULTS[name].model_construct().unsupported(device) is None]
    raise UsageError(
        f"the device {device.info.name!r} can't have the fault {FAULTS.name_of(fault)!r}: {reason}; possible faults: "
        f"{', '.join(able)}"
    )

"""Devices around the twin that fail in one way each, for the tests of the fault table."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

from servobench.core.channels import Sample
from servobench.rig.devices.base import RunEnded
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.experiment import Limits


class Bench(Twin):
    """The twin, which notes each voltage that reaches it."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(TwinSettings(**settings))
        self.reached: list[float] = []

    def write(self, voltage: float) -> float:
        self.reached.append(voltage)
        return super().write(voltage)


class Stuck(Bench):
    """Its encoder shows from a time [s] on what it showed then; with `toggling` one of its two channels still works."""

    def __init__(self, since: float, *, toggling: bool = False, **settings: Any) -> None:
        super().__init__(**settings)
        self.since, self.toggling = since, toggling
        self.shown: int | None = None

    def read(self) -> Sample:
        sample = super().read()
        if sample.time < self.since:
            return sample
        if self.shown is None:
            self.shown = sample.counts
        # With A stuck the states of B are one count apart, forth and back.
        return dataclasses.replace(sample, counts=self.shown + (sample.counts & 1 if self.toggling else 0))


class Jammed(Bench):
    """Its shaft is held from a time [s] on: the encoder stands, and the winding draws what it draws at rest."""

    def __init__(self, since: float, **settings: Any) -> None:
        super().__init__(**settings)
        self.since = since
        self.shown: int | None = None
        self.voltage = 0.0

    def read(self) -> Sample:
        sample = super().read()
        if sample.time < self.since:
            return sample
        if self.shown is None:
            self.shown = sample.counts
        drawn = self.voltage / self.settings.parameters.resistance
        current = None if sample.current is None else max(-3.0, min(3.0, drawn))
        return dataclasses.replace(sample, counts=self.shown, current=current)

    def write(self, voltage: float) -> float:
        self.voltage = super().write(voltage)
        return self.voltage


def drive(
    device: Any,
    voltages: Sequence[float] | Callable[[float], float],
    *,
    sample_time: float = 0.002,
    duration: float = math.inf,
    limits: Limits | None = None,
    seed: int = 0,
) -> Guarded:
    """Drive a guarded device with voltages, or with a function of time, to their end or to a fault; it isn't stopped."""
    guarded = Guarded(device, limits)
    guarded.start(sample_time, seed)
    ticks = round(duration / sample_time) if callable(voltages) else len(voltages)
    try:
        for k in range(ticks):
            guarded.read()
            guarded.write(voltages(k * sample_time) if callable(voltages) else voltages[k])
    except RunEnded:
        assert guarded.fault is not None
    return guarded

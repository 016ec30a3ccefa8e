"""Benches that tests commission: the twin in virtual time, and twins with what a maker got wrong."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.settings import PositiveVoltage
from servobench.recordings.recording import Recording, Stopped
from servobench.rig.commission.acceptance import Acceptance, commission
from servobench.rig.commission.bench import Bench
from servobench.rig.commission.checks.base import Outcome
from servobench.rig.devices.base import Device, RunEnded
from servobench.rig.devices.faulty import with_faults
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.rig.loop.run import Look, run

CREATED = "2026-11-23T12:00:00+00:00"


class OffsetTwin(Twin):
    """Its amplifier puts 0.5 V too much out."""

    def write(self, voltage: float) -> float:
        return super().write(voltage + 0.5)


class RunawayTwin(Twin):
    """It holds the largest voltage that it ever got, whatever comes then; only a stop ends it."""

    _held = 0.0

    def start(self, sample_time: float, seed: int | None) -> None:
        super().start(sample_time, seed)
        self._held = 0.0

    def write(self, voltage: float) -> float:
        self._held = max(self._held, abs(voltage))
        super().write(self._held)
        return voltage


class DeadWatchdogTwin(Twin):
    """It promises a watchdog and has none."""

    @property
    def own_watchdog(self) -> float | None:
        return 0.05

    def _has_expired(self, now: float) -> bool:
        return False


class WeakWatchdogTwin(DeadWatchdogTwin):
    """It halves the voltage in place of taking it away, 50 samples after the last one came."""

    _last, _since = 0.0, 0

    def write(self, voltage: float) -> float:
        self._last, self._since = voltage, 0
        return super().write(voltage)

    def read(self) -> Sample:
        sample = super().read()
        self._since += 1
        if self._since > 50:
            super().write(self._last / 2)
        return sample


class EarlyTwin(Twin):
    """It says that it is 6 ms late, and isn't."""

    @property
    def info(self) -> DeviceInfo:
        return replace(super().info, delay=0.006)


class OneWayTwin(Twin):
    """The direction pin of its bridge is dead."""

    def write(self, voltage: float) -> float:
        super().write(abs(voltage))
        return voltage


class _StallSettings(TwinSettings):
    stall_voltage: PositiveVoltage = 5.0


class DeadStallTwin(Twin):
    """It has a setting for a stall, and does nothing about one."""

    Settings: ClassVar[type[TwinSettings]] = _StallSettings


class HastyStallTwin(DeadStallTwin):
    """It takes a shaft that stands for a second for a stalled one, once it is set to a lower voltage."""

    def read(self) -> Sample:
        sample = super().read()
        assert isinstance(self.settings, _StallSettings)
        if self.settings.stall_voltage < 5.0 and sample.time > 1.0:
            raise RunEnded(Stopped(reason="fault", sentence="the board reports a stall"), sample)
        return sample


class NarrowTwin(Twin):
    """It says that its counter has 32 bits, whatever it has."""

    @property
    def info(self) -> DeviceInfo:
        info = super().info
        channels = tuple(
            replace(each, counter_bits=32) if each.name == "counts" else each for each in info.channels
        )
        return replace(info, channels=channels)


class EightBitTwin(NarrowTwin):
    """It counts with eight bits."""

    def read(self) -> Sample:
        sample = super().read()
        return replace(sample, counts=(sample.counts + 128) % 256 - 128)


@dataclass
class SimulatedPerson:
    """Somebody who turns the shaft of the next run steadily by so many counts."""

    turns: float
    counts: float
    busy: bool = False

    def begin(self) -> tuple[float, Look | None]:
        self.busy = True
        return 2.0, None


class TurnedTwin(Twin):
    """Its shaft is turned by hand in runs at zero volts while the person is busy."""

    person: ClassVar[SimulatedPerson]

    def read(self) -> Sample:
        sample = super().read()
        if not self.person.busy:
            return sample
        # From 0.5 s to 1.5 s of the run; between, a half of a count doesn't exist.
        part = float(np.clip(sample.time - 0.5, 0.0, 1.0))
        return replace(sample, counts=sample.counts + round(part * self.person.counts))


@dataclass
class Commissioned:
    """A bench, what came out, and every voltage that reached a device, with the check that it was for."""

    bench: Bench
    acceptance: Acceptance
    put_out: list[tuple[str, float]] = field(default_factory=list)
    at_rest: list[bool] = field(default_factory=list)

    def outcome(self, check: str) -> Outcome:
        return next(each.outcome for each in self.acceptance.checks if each.name == check)

    def figure(self, check: str, name: str) -> tuple[float, tuple[float, float] | None]:
        found = next(each for each in self.outcome(check).figures if each.name == name)
        return found.value, found.interval


def commissioned(
    kind: type[Twin] = Twin,
    *,
    faults: Sequence[Mapping[str, Any]] = (),
    person: SimulatedPerson | None = None,
    until_wrap: bool = False,
    interrupt: str = "",
    limit: float | None = None,
    **settings: Any,
) -> Commissioned:
    """Commission a twin of that kind; a run of the check `interrupt` is interrupted in its middle."""
    choice = DeviceChoice(name="twin", settings=settings, faults=tuple(faults))
    put_out: list[tuple[str, float]] = []
    at_rest: list[bool] = []

    def make(asked: DeviceChoice) -> tuple[Device, Twin]:
        motor = kind(kind.Settings.model_validate(asked.settings))
        return with_faults(motor, asked.faults), motor

    def carry_out(asked: Experiment, name: str, look: Look | None) -> Recording:
        device, motor = make(asked.device)
        check = asked.name.removeprefix("commission: ")
        with device:
            _listen(motor, check, put_out)
            try:
                return run(asked, device, look=look, watch=_interrupt if check == interrupt else None)
            finally:
                # Friction stops an undriven shaft within some time constants; a driven one turns on.
                at_rest.append(motor.coast(20.0).speed == 0.0)
                if person is not None:
                    person.busy = False

    bench = Bench(make(choice)[0], choice, carry_out, limit=limit, person=person, until_wrap=until_wrap)
    return Commissioned(bench, commission(bench, CREATED), put_out, at_rest)


def _listen(motor: Twin, check: str, put_out: list[tuple[str, float]]) -> None:
    """Note each voltage that acts on the motor of a run, whatever a double makes of what it is told."""
    begin = motor.start

    def start(sample_time: float, seed: int | None) -> None:
        begin(sample_time, seed)
        plant = motor._require_plant()
        act: Callable[[float, float], None] = plant.act

        def noted(voltage: float, at: float) -> None:
            put_out.append((check, voltage))
            act(voltage, at)

        plant.act = noted  # type: ignore[method-assign]

    motor.start = start  # type: ignore[method-assign]


def _interrupt(progress: Any) -> None:
    if progress.time >= 0.25:
        raise KeyboardInterrupt

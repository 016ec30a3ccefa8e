"""The common part of tests of injected faults: the undisturbed run, and the one with faults, by the same seed."""

from collections.abc import Callable

from servobench.core.channels import Channel, DeviceInfo, Sample
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import Fault, fault_from, table_of
from servobench.rig.devices.faulty import Faulty
from servobench.rig.devices.twin import Twin, TwinSettings
from tests.rig.loop.shaft import Shaft

H = 0.002  # s
MOTOR = TwinSettings(tachometer=True, torque_noise=1e-5)


def fault(text: str) -> Fault:
    return fault_from(table_of(text))


def faulty(*texts: str, motor: TwinSettings = MOTOR, seed: int | None = None) -> Faulty:
    return Faulty(Twin(motor), [fault(text) for text in texts], seed)


def driven(device: Device, ticks: int, voltage: Callable[[int], float] = lambda k: 4.0) -> list[Sample]:
    """The samples of some ticks; the voltage answers the sample, by its number."""
    samples = []
    with device:
        device.start(H, 5)
        for _ in range(ticks):
            sample = device.read()
            samples.append(sample)
            device.write(voltage(sample.index))
    return samples


def undisturbed(ticks: int, voltage: Callable[[int], float] = lambda k: 4.0) -> list[Sample]:
    return driven(Twin(MOTOR), ticks, voltage)


class Numbered(Shaft):
    """A device with its own time, a width of its counter, and counts by a function of the sample's number."""

    def __init__(
        self,
        count: Callable[[int], int],
        bits: int | None = None,
        timing: str = "device",
        counts_per_rev: float | None = None,
    ) -> None:
        super().__init__(timing=timing)  # type: ignore[arg-type]
        self.count = count
        self.bits = bits
        self.counts_per_rev = counts_per_rev

    @property
    def info(self) -> DeviceInfo:
        counts = Channel(
            name="counts",
            unit="counts",
            counter_bits=self.bits,
            counts_per_rev=self.counts_per_rev,
            resolution=1.0,
        )
        return DeviceInfo(
            name="numbered", channels=(Channel(name="voltage", unit="V"), counts), timing=self.timing
        )

    def __enter__(self) -> "Numbered":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def read(self) -> Sample:
        self.index += 1
        return Sample(
            index=self.index,
            time=self.index * self.sample_time,
            counts=wrapped(self.count(self.index), self.bits),
        )


def wrapped(count: int, bits: int | None) -> int:
    """The value of a signed counter, bit by bit: the low bits, the highest of which has a negative weight."""
    if bits is None:
        return count
    low = count & ((1 << bits) - 1)
    return low - (1 << bits) if low >> (bits - 1) else low

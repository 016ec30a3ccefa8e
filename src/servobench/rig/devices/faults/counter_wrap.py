"""A counter that is narrower, or begins near its wrap."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, Self

from pydantic import model_validator

from servobench.core.channels import Channel, DeviceInfo, Sample
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import FAULTS, Fault, Injected, Injection, Latch
from servobench.rig.devices.faults.counting import counter_bits, wrap_count


@FAULTS.member("counter_wrap")
class CounterWrap(Fault):
    """The encoder is counted by a signed counter of `bits` bits: (counts + offset + 2^(bits-1)) mod 2^bits - 2^(bits-1).

    The device says that width of itself, so that nothing is wrong with the data: the wraps can be taken out.
    """

    bits: Literal[16, 24, 32] = 16
    """Width of the counter."""
    start: int | None = None
    """The count at the first sample; by default the device's own."""

    @model_validator(mode="after")
    def _start_can_be_shown(self) -> Self:
        half = 1 << (self.bits - 1)
        if self.start is not None and not -half <= self.start < half:
            raise ValueError(
                f"start = {self.start} doesn't fit into {self.bits} bits; expected {-half} to {half - 1}"
            )
        return self

    def unsupported(self, device: Device) -> str | None:
        """A counter can only be made narrower."""
        bits = counter_bits(device.info)
        if bits is not None and bits < self.bits:
            return f"its counter has {bits} bits, too few for one of {self.bits}"
        return None

    def info_shown(self, info: DeviceInfo) -> DeviceInfo:
        """Its counter has that width."""

        def narrow(channel: Channel) -> Channel:
            return replace(channel, counter_bits=self.bits) if channel.name == "counts" else channel

        return replace(info, channels=tuple(map(narrow, info.channels)))

    def begin(self, run: Injected) -> Injection:
        """Wrap each sample's counts. As 2^bits divides the device's own range, its own wraps make no difference."""
        offset: int | None = None

        def read(latch: Latch) -> Sample:
            nonlocal offset
            sample = latch()
            if offset is None:
                offset = 0 if self.start is None else self.start - sample.counts
            return replace(sample, counts=wrap_count(sample.counts + offset, self.bits))

        return Injection(read=read)

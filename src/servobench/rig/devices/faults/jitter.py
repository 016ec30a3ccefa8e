"""Samples that are latched late by chance."""

from __future__ import annotations

from dataclasses import replace

from servobench.core.channels import Sample
from servobench.core.errors import UsageError
from servobench.core.settings import PositiveTime
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Latch, Occasional, Simulated


@FAULTS.member("jitter")
class Jitter(Occasional):
    """A sample is latched late by a time that is uniform from 0 to `largest`, and so is the voltage that answers it.

    `recorded` says whether the sample's time tells so. By host time it can't: the clock notes the time before it asks.
    """

    sees_every_sample = False

    largest: PositiveTime = 2e-4
    """The largest lateness; less than the sample time [s]."""
    recorded: bool = True
    """Whether the sample's time is that of the latch, or that of the schedule."""

    def unsupported(self, device: Device) -> str | None:
        """By virtual time it takes a simulated motor; a device with its own time can't be held up."""
        timing = device.info.timing
        if timing == "host":
            return (
                "its clock records the time before it asks, so set recorded = false"
                if self.recorded
                else None
            )
        if timing == "virtual" and isinstance(device, Simulated):
            return None
        return "it samples by its own clock, which can't be changed"

    def begin(self, run: Injected) -> Injection:
        """Hold up each latch for which it is to happen."""
        if self.largest >= run.sample_time:
            raise UsageError(
                f"jitter: the largest lateness is {self.largest:g} s; expected less than the sample time of "
                f"{run.sample_time:g} s; for whole ticks use slow_read or lost"
            )
        happens = self.occasions(run)

        def read(latch: Latch) -> Sample:
            late = self.largest * run.random.random() if happens(self.will_hold(run)) else 0.0
            run.hold_up(late)
            sample = latch()
            return sample if self.recorded else replace(sample, time=sample.time - late)

        return Injection(read=read)

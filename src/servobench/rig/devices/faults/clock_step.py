"""A device clock that is set."""

from __future__ import annotations

from dataclasses import replace

from servobench.core.channels import Sample
from servobench.core.settings import Time
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Lasting, Latch
from servobench.rig.devices.faults.timekeeping import keeps_own_time


@FAULTS.member("clock_step")
class ClockStep(Lasting):
    """The device's time jumps, forward or back, and stays so for a while or to the end; the samples' numbers go on as before."""

    sees_every_sample = False

    by: Time = 0.1
    """The size of the jump; below 0 the clock goes back [s]."""

    def unsupported(self, device: Device) -> str | None:
        """It takes a device whose samples carry its own time."""
        return keeps_own_time(device)

    def begin(self, run: Injected) -> Injection:
        """Shift the times of the samples."""

        def read(latch: Latch) -> Sample:
            sample = latch()
            return replace(sample, time=sample.time + self.by) if self.holds(run) else sample

        return Injection(read=read)

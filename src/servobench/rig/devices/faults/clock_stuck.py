"""A device clock that stands still."""

from __future__ import annotations

from dataclasses import replace

from servobench.core.channels import Sample
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Lasting, Latch
from servobench.rig.devices.faults.timekeeping import keeps_own_time


@FAULTS.member("clock_stuck")
class ClockStuck(Lasting):
    """The samples carry the same time again and again, and the right one afterwards; their numbers go on as before."""

    sees_every_sample = False

    def unsupported(self, device: Device) -> str | None:
        """It takes a device whose samples carry its own time."""
        return keeps_own_time(device)

    def begin(self, run: Injected) -> Injection:
        """Hold the time of the first sample."""
        stuck: float | None = None

        def read(latch: Latch) -> Sample:
            nonlocal stuck
            sample = latch()
            if not self.holds(run):
                return sample
            stuck = sample.time if stuck is None else stuck
            return replace(sample, time=stuck)

        return Injection(read=read)

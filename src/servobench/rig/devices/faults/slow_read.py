"""Reads that take long."""

from __future__ import annotations

from servobench.core.channels import Sample
from servobench.core.settings import PositiveTime
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Latch, Occasional, Simulated


@FAULTS.member("slow_read")
class SlowRead(Occasional):
    """A read takes long, and latches at its end.

    Whole ticks that go by meanwhile are missed, and the last voltage holds through them. By host time the read sleeps. In virtual
    time nothing waits: the sample is the one that is due by then, and late.
    """

    sees_every_sample = False

    takes: PositiveTime = 0.01
    """The time that such a read takes [s]."""

    def unsupported(self, device: Device) -> str | None:
        """By virtual time it takes a simulated motor; a device with its own time can't be held up."""
        timing = device.info.timing
        if timing == "host" or (timing == "virtual" and isinstance(device, Simulated)):
            return None
        return "it samples by its own clock, however long a read takes"

    def begin(self, run: Injected) -> Injection:
        """Hold up each latch for which it is to happen."""
        happens = self.occasions(run)

        def read(latch: Latch) -> Sample:
            if happens(self.will_hold(run)):
                run.hold_up(self.takes)
            return latch()

        return Injection(read=read)

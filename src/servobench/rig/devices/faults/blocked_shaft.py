"""A shaft that is blocked."""

from __future__ import annotations

from servobench.core.channels import Sample
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Lasting, Latch, Simulated


@FAULTS.member("blocked_shaft")
class BlockedShaft(Lasting):
    """Something holds the shaft where it is, whatever the voltage; the current goes to that of a stalled motor, u/R."""

    sees_every_sample = False

    def unsupported(self, device: Device) -> str | None:
        """It takes a simulated motor."""
        return (
            None
            if isinstance(device, Simulated)
            else "a real shaft can't be blocked by software; use a simulated motor"
        )

    def begin(self, run: Injected) -> Injection:
        """Take hold of the shaft at the first sample of the time, and let it go at the first one after."""
        device = run.device
        if not isinstance(device, Simulated):  # was refused before
            return Injection()

        def read(latch: Latch) -> Sample:
            sample = latch()
            device.block(self.holds(run))
            return sample

        return Injection(read=read)

"""Voltages that don't reach the device."""

from __future__ import annotations

from servobench.core.channels import Sample
from servobench.rig.devices.base import Device, RunEnded
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Lasting, Latch, Put


@FAULTS.member("starved")
class Starved(Lasting):
    """No voltage reaches the device, as where the computer hangs: its own watchdog starves. Samples go on.

    Where the device has no watchdog the last voltage holds. What is told as applied is that last voltage, as nothing says
    better. A device that ends the run then isn't listened to, so that the recording shows what the shaft does. The stop goes
    through all the same, as a fault that is injected must not leave a motor turning.
    """

    def unsupported(self, device: Device) -> str | None:
        """It takes a device that voltages drive."""
        return None if getattr(device, "drives", True) else "no voltage drives it"

    def begin(self, run: Injected) -> Injection:
        """Keep each voltage of that time back."""
        last = 0.0

        def read(latch: Latch) -> Sample:
            try:
                return latch()
            except RunEnded as end:
                if not self.will_hold(run) or end.stopped.reason != "fault":
                    raise
            return latch()

        def write(voltage: float, put: Put) -> float:
            nonlocal last
            if not self.holds(run):
                last = put(voltage)
            return last

        return Injection(read=read, write=write)

"""A device that is unplugged."""

from __future__ import annotations

from servobench.core.channels import Sample
from servobench.core.errors import DeviceError
from servobench.rig.devices.faults.base import FAULTS, Final, Injected, Injection, Latch, Put


@FAULTS.member("device_unplugged")
class DeviceUnplugged(Final):
    """The device stops answering: each read and write fails, to the end of the run.

    The stop goes through all the same, as a fault that is injected must not leave a motor turning.
    """

    sees_every_sample = False

    def begin(self, run: Injected) -> Injection:
        """Fail from the first sample of that time on."""
        gone = False

        def check() -> None:
            if gone:
                raise DeviceError(
                    f"the device {run.device.info.name!r} no longer responds (unplugged on purpose by the fault "
                    "device_unplugged)"
                )

        def read(latch: Latch) -> Sample:
            nonlocal gone
            check()
            sample = latch()
            gone = self.is_due(run)
            check()
            return sample

        def write(voltage: float, put: Put) -> float:
            check()
            return put(voltage)

        return Injection(read=read, write=write)

"""Values that aren't numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Literal

from servobench.core.channels import Sample
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Latch, Occasional, Put


@FAULTS.member("nan")
class Nan(Occasional):
    """A measured value, or the device's answer to a voltage, is not a number (NaN)."""

    sees_every_sample = False

    channel: Literal["applied", "counts", "current", "tachometer"] = "applied"
    """The channel: applied (the answer to a voltage), counts, current or tachometer."""

    def unsupported(self, device: Device) -> str | None:
        """It takes the channel."""
        if self.channel == "applied" or device.info.channel(self.channel) is not None:
            return None
        return f"it has no channel {self.channel!r}"

    def begin(self, run: Injected) -> Injection:
        """Put NaN in the place of the value, or of the answer."""
        happens = self.occasions(run)
        struck = False

        def read(latch: Latch) -> Sample:
            nonlocal struck
            sample = latch()
            struck = happens(self.holds(run))
            if not struck or self.channel == "applied":
                return sample
            values: dict[str, Any] = {self.channel: math.nan}
            return replace(sample, **values)

        def write(voltage: float, put: Put) -> float:
            applied = put(voltage)
            return math.nan if struck and self.channel == "applied" else applied

        return Injection(read=read, write=write)

"""Values that weren't renewed."""

from __future__ import annotations

from dataclasses import replace

from servobench.core.channels import Sample
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Latch, Occasional


@FAULTS.member("stale")
class Stale(Occasional):
    """A sample has its own number and time, but the values of the sample before: the device hadn't renewed them."""

    def begin(self, run: Injected) -> Injection:
        """Put the values of the sample before into the next."""
        happens = self.occasions(run)
        before: Sample | None = None

        def read(latch: Latch) -> Sample:
            nonlocal before
            sample = latch()
            if happens(self.holds(run)) and before is not None:
                sample = replace(before, index=sample.index, time=sample.time)
            before = sample
            return sample

        return Injection(read=read)

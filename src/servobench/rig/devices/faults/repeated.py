"""Samples that arrive twice."""

from __future__ import annotations

from servobench.core.channels import Sample
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Latch, Occasional


@FAULTS.member("repeated")
class Repeated(Occasional):
    """A sample arrives a second time in place of the next one, which then arrives after it: same values, number and time.

    Where the device numbers its samples, that ends the run: what comes out of order can't be trusted.
    """

    sees_every_sample = False

    def begin(self, run: Injected) -> Injection:
        """Keep a sample that is to arrive twice, and give it at the next read."""
        happens = self.occasions(run)
        again: Sample | None = None

        def read(latch: Latch) -> Sample:
            nonlocal again
            if again is not None:
                sample, again = again, None
                return sample
            sample = latch()
            again = sample if happens(self.holds(run)) else None
            return sample

        return Injection(read=read)

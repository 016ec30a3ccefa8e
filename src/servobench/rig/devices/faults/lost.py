"""Samples that don't arrive."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from servobench.core.channels import Sample
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Latch, Occasional


@FAULTS.member("lost")
class Lost(Occasional):
    """A sample is latched and never arrives; the next one does, with a number that tells. The last voltage holds meanwhile.

    The first sample isn't lost: a run begins with the first that arrives.
    """

    sees_every_sample = False

    @model_validator(mode="after")
    def _check_loss(self) -> Self:
        each = self.every == 1 or self.probability == 1 or (self.every is None and self.probability is None)
        if self.for_ is None and each:
            raise ValueError(
                "would lose every sample and never end; give `for`, a probability below 1 or every above 1"
            )
        return self

    def unsupported(self, device: Device) -> str | None:
        """It takes a device that numbers its samples."""
        if device.info.timing == "host":
            return "the computer's clock numbers its samples, so none can be lost on the way"
        return None

    def begin(self, run: Injected) -> Injection:
        """Take the next sample in place of one that is lost."""
        happens = self.occasions(run)
        begun = False

        def read(latch: Latch) -> Sample:
            nonlocal begun
            sample = latch()
            while happens(self.holds(run)) and begun:
                sample = latch()
            begun = True
            return sample

        return Injection(read=read)

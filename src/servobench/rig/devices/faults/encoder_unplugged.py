"""An encoder that is unplugged."""

from __future__ import annotations

from dataclasses import replace

from servobench.core.channels import Sample
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Lasting, Latch
from servobench.rig.devices.faults.counting import Travel, counter_bits, wrap_count


@FAULTS.member("encoder_unplugged")
class EncoderUnplugged(Lasting):
    """The counts stay as they are while the motor turns; plugged in again, counting goes on from there."""

    def begin(self, run: Injected) -> Injection:
        """Leave out what the shaft goes meanwhile."""
        bits = counter_bits(run.device.info)
        travel = Travel(bits)
        missing = 0
        unplugged = False

        def read(latch: Latch) -> Sample:
            nonlocal missing, unplugged
            sample = latch()
            went = travel.went(sample.counts)
            missing += went if unplugged else 0
            unplugged = self.holds(run)
            return replace(sample, counts=wrap_count(travel.count - missing, bits))

        return Injection(read=read)

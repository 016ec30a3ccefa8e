"""An encoder whose channels are swapped."""

from __future__ import annotations

from dataclasses import replace

from servobench.core.channels import Sample
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Lasting, Latch
from servobench.rig.devices.faults.counting import Travel, counter_bits, wrap_count


@FAULTS.member("encoder_flipped")
class EncoderFlipped(Lasting):
    """The counts go the other way, as with the encoder's channels or the motor's leads swapped; a controller drives it away."""

    def begin(self, run: Injected) -> Injection:
        """Count backwards what the shaft goes meanwhile, from the count at which it began."""
        bits = counter_bits(run.device.info)
        travel = Travel(bits)
        shown: int | None = None
        flipped = False

        def read(latch: Latch) -> Sample:
            nonlocal shown, flipped
            sample = latch()
            went = travel.went(sample.counts)
            shown = travel.count if shown is None else shown + (-went if flipped else went)
            flipped = self.holds(run)
            return replace(sample, counts=wrap_count(shown, bits))

        return Injection(read=read)

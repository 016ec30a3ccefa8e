"""An encoder channel that is stuck."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from servobench.core.channels import Sample
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Lasting, Latch
from servobench.rig.devices.faults.counting import Travel, counter_bits, wrap_count

# Channels A and B through four counts of forward motion, and where each pair of levels lies in them.
_LEVELS = ((0, 0), (1, 0), (1, 1), (0, 1))
_PLACE = {levels: place for place, levels in enumerate(_LEVELS)}


@FAULTS.member("stuck_channel")
class StuckChannel(Lasting):
    """One channel of the encoder keeps its level, so that the quadrature decoder counts the other's edges forth and back: ±1.

    No transition is against the rules, so no decoder can tell; the counts in between are lost for good.
    The channel keeps the level that it has at the first sample of the time.
    """

    channel: Literal["A", "B"] = "A"
    """The channel that is stuck: A or B."""

    def begin(self, run: Injected) -> Injection:
        """Decode the count of each sample from the levels of the two channels."""
        bits = counter_bits(run.device.info)
        travel = Travel(bits)
        which = "AB".index(self.channel)
        decoded: int | None = None
        stuck: int | None = None

        def read(latch: Latch) -> Sample:
            nonlocal decoded, stuck
            sample = latch()
            went = travel.went(sample.counts)
            if decoded is None:
                decoded = travel.count
            levels = list(_LEVELS[travel.count % 4])
            if stuck is None:
                decoded += went
            else:
                levels[which] = stuck
                decoded = _decode(decoded, levels)
            if self.holds(run):
                stuck = levels[which]
            elif stuck is not None:
                # Let go, the channel jumps to its true level, which the decoder takes for an edge if it is another.
                stuck, decoded = None, _decode(decoded, list(_LEVELS[travel.count % 4]))
            return replace(sample, counts=wrap_count(decoded, bits))

        return Injection(read=read)


def _decode(before: int, levels: list[int]) -> int:
    """The decoder's count after one of the two channels may have changed; its place in four is that of the levels it saw."""
    return before + (_PLACE[levels[0], levels[1]] - before + 1) % 4 - 1

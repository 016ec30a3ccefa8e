"""Encoder edges that are lost in bursts."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from pydantic import Field

from servobench.core.channels import Sample
from servobench.core.settings import PositiveTime
from servobench.rig.devices.faults.base import FAULTS, Injected, Injection, Latch, Occasional
from servobench.rig.devices.faults.counting import Travel, counter_bits, wrap_count


@FAULTS.member("dropouts")
class Dropouts(Occasional):
    """In bursts, edges of the encoder aren't counted: of the counts between two samples each is lost with a probability `share`.

    Lost counts stay lost: the position is off by them from then on. A burst begins at a sample for which the fault happens, where
    none is on.
    """

    share: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] = 0.5
    """The probability for an edge in a burst to be lost, from 0 to 1."""
    burst: PositiveTime = 0.01
    """Length of a burst [s]."""

    def begin(self, run: Injected) -> Injection:
        """Take the lost counts off each sample."""
        happens = self.occasions(run)
        bits = counter_bits(run.device.info)
        travel = Travel(bits)
        left = lost = 0
        length = max(1, round(self.burst / run.sample_time))

        def read(latch: Latch) -> Sample:
            nonlocal left, lost
            sample = latch()
            went = travel.went(sample.counts)
            if left:
                left -= 1
                missing = int(run.random.binomial(abs(went), self.share))
                lost += missing if went > 0 else -missing
            begins = happens(self.holds(run))
            if begins and not left:
                left = length
            return replace(sample, counts=wrap_count(travel.count - lost, bits))

        return Injection(read=read)

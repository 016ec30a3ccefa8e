"""A device that restarts, as one that was plugged in again."""

from __future__ import annotations

from dataclasses import replace

from servobench.core.channels import Sample
from servobench.rig.devices.faults.base import FAULTS, Final, Injected, Injection, Latch, Put
from servobench.rig.devices.faults.counting import Travel, counter_bits, wrap_count


@FAULTS.member("restart")
class Restart(Final):
    """The device restarts: its counter, its samples' numbers and its time begin at 0 again.

    It puts out zero volts from then on, to the end of the run. Where the device numbers its samples, that ends the run; by host
    time only the counts tell.
    """

    def begin(self, run: Injected) -> Injection:
        """Count from zero again from the first sample at or after that time."""
        bits = counter_bits(run.device.info)
        travel = Travel(bits)
        first: Sample | None = None
        count = 0

        def read(latch: Latch) -> Sample:
            nonlocal first, count
            sample = latch()
            travel.went(sample.counts)
            if first is None and self.is_due(run):
                first, count = sample, travel.count
            if first is None:
                return sample
            return replace(
                sample,
                index=sample.index - first.index,
                time=sample.time - first.time,
                counts=wrap_count(travel.count - count, bits),
            )

        def write(voltage: float, put: Put) -> float:
            return put(voltage if first is None else 0.0)

        return Injection(read=read, write=write)

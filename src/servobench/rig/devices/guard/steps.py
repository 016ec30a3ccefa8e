"""Encoder steps that no motor can make."""

from __future__ import annotations

import math
from typing import ClassVar, Self

from servobench.core.finding import Finding
from servobench.core.rounding import milliseconds
from servobench.rig.devices import handover as at
from servobench.rig.devices.guard.base import MONITORS, Alarm, Motion, Rig
from servobench.rig.devices.handover import Handover

_FASTER = 1.5  # than the nominal motor without a load at the largest voltage; a motor constant 20 % too small makes 1.25
ROUNDING = 2  # counts that rounding may add to a step


@MONITORS.member("steps")
class StepMonitor:
    """A fault where the encoder steps by more between two samples than the motor can turn.

    The largest step is ω_max (Δt + T) and two counts for rounding: Δt is the time between the samples as they say, T the sample
    time, as a sample may be latched up to a tick after the time that it says. ω_max is `limits.possible_speed`, or else 1.5 K u
    of the nominal motor at the largest voltage. Where half of the counter's range could pass in Δt, wraps can't be counted,
    and that is a fault as well. Without any ω_max a step of exactly half of the range is one.
    """

    heading: ClassVar[str] = "Step of the encoder"
    codes: ClassVar[tuple[str, ...]] = ("encoder-step-impossible", "wraps-unknown")

    def __init__(self, fastest: float | None, half: int, sample_time: float) -> None:
        self._fastest, self._half, self._sample_time = fastest, half, sample_time

    @classmethod
    def of(cls, rig: Rig) -> Self | None:
        """Return a monitor where a speed is known that the motor can't have, or the counter's range."""
        fastest = rig.limits.possible_speed
        if fastest is None and rig.nominal is not None and rig.in_volts:
            fastest = _FASTER * rig.nominal.gain * rig.limits.voltage
        channel = rig.info.channel("counts")
        half = 1 << (channel.counter_bits - 1) if channel and channel.counter_bits else 0
        in_counts = fastest / rig.angle if fastest is not None and rig.angle else None
        return cls(in_counts, half, rig.sample_time) if in_counts is not None or half else None

    @property
    def limit(self) -> str:
        """The largest step."""
        return (
            f"less than {self._half} counts"
            if self._fastest is None
            else f"at most {self._fastest * self._sample_time:.0f} counts in a sample time, that again, and {ROUNDING}"
        )

    def check(self, motion: Motion) -> Alarm | None:
        """Return an alarm where a step, or the time that it took, is too long."""
        step = motion.step if motion.step >= 0 else -motion.step
        if self._fastest is None:
            return self._alarm(motion, self._half - 1) if step >= self._half else None
        possible = self._fastest * motion.dt
        if self._half and possible >= self._half:
            return Alarm(
                "wraps-unknown",
                f"{milliseconds(motion.dt)} ms passed between two samples, so the counter may have wrapped "
                "unnoticed and the position is lost: sample faster, or use a wider counter",
            )
        largest = possible + self._fastest * self._sample_time + ROUNDING
        return self._alarm(motion, largest) if step > largest else None

    def hand_over(self, to: Handover) -> None:
        """Write the limit."""
        to.p[at.STEPS] = 1.0
        to.p[at.FASTEST_STEP] = math.nan if self._fastest is None else self._fastest

    def take_back(self, block: Handover) -> None:
        """Read nothing: there is no state."""

    def findings(self) -> tuple[Finding, ...]:
        """Return nothing: what there is to say is the fault."""
        return ()

    def _alarm(self, motion: Motion, largest: float) -> Alarm:
        return Alarm(
            "encoder-step-impossible",
            f"the encoder stepped by {motion.step} counts in {milliseconds(motion.dt)} ms, and a motor can make at "
            f"most {largest:.0f}; check its cable, or set limits.possible_speed",
        )

"""The largest speed."""

from __future__ import annotations

from typing import ClassVar, Self

from servobench.core.errors import UsageError
from servobench.core.finding import Finding
from servobench.rig.devices import handover as at
from servobench.rig.devices.guard.base import MONITORS, Alarm, Motion, Rig
from servobench.rig.devices.handover import Handover


@MONITORS.member("speed")
class SpeedMonitor:
    """A fault where the encoder's speed, smoothed over 10 ms, or the tachometer's is above `limits.speed`."""

    heading: ClassVar[str] = "Speed"
    codes: ClassVar[tuple[str, ...]] = ("speed-above-limit",)

    def __init__(self, limit: float) -> None:
        self._limit = limit

    @classmethod
    def of(cls, rig: Rig) -> Self | None:
        """Return a monitor where there is a limit; raises `UsageError` if the device's speed can't be determined."""
        if rig.limits.speed is None:
            return None
        if rig.angle is None:
            raise UsageError(
                f"limits.speed is {rig.limits.speed:g} rad/s, but the device {rig.info.name!r} doesn't say how many counts "
                "make a turn (counts_per_rev); leave that limit out"
            )
        return cls(rig.limits.speed)

    @property
    def limit(self) -> str:
        """The largest speed."""
        return f"at most {self._limit:g} rad/s"

    def check(self, motion: Motion) -> Alarm | None:
        """Return an alarm where the speed isn't within the limit."""
        if motion.fastest <= self._limit:
            return None
        return Alarm(
            "speed-above-limit",
            f"the speed was {motion.fastest:.3g} rad/s, above the limit of {self._limit:g} rad/s; use a lower "
            "voltage, or raise limits.speed",
        )

    def hand_over(self, to: Handover) -> None:
        """Write the limit."""
        to.p[at.MOST_SPEED] = self._limit

    def take_back(self, block: Handover) -> None:
        """Read nothing: there is no state."""

    def findings(self) -> tuple[Finding, ...]:
        """Return nothing: what there is to say is the fault."""
        return ()

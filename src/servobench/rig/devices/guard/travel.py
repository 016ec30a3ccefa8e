"""The largest angle from the start."""

from __future__ import annotations

import math
from typing import ClassVar, Self

from servobench.core.errors import UsageError
from servobench.core.finding import Finding
from servobench.rig.devices import handover as at
from servobench.rig.devices.guard.base import MONITORS, Alarm, Motion, Rig
from servobench.rig.devices.handover import Handover


@MONITORS.member("travel")
class TravelMonitor:
    """A fault where the shaft is further than `limits.travel` from where the first sample found it."""

    heading: ClassVar[str] = "Travel"
    codes: ClassVar[tuple[str, ...]] = ("travel-above-limit",)

    def __init__(self, limit: float, angle: float) -> None:
        self._limit, self._angle = limit, angle
        self._most = math.floor(limit / angle)

    @classmethod
    def of(cls, rig: Rig) -> Self | None:
        """Return a monitor where there is a limit; raises `UsageError` if the device's angle can't be determined."""
        if rig.limits.travel is None:
            return None
        if rig.angle is None:
            raise UsageError(
                f"limits.travel is {rig.limits.travel:g} rad, but the device {rig.info.name!r} doesn't say how many counts "
                "make a turn (counts_per_rev); leave that limit out"
            )
        return cls(rig.limits.travel, rig.angle)

    @property
    def limit(self) -> str:
        """The largest angle."""
        return f"at most {self._limit:g} rad from the start"

    def check(self, motion: Motion) -> Alarm | None:
        """Return an alarm where the shaft is beyond the limit."""
        if -self._most <= motion.position <= self._most:
            return None
        return Alarm(
            "travel-above-limit",
            f"the shaft was {motion.position * self._angle:.3g} rad from its start, beyond the limit of "
            f"{self._limit:g} rad; turn it back by hand, and use a lower or shorter voltage",
        )

    def hand_over(self, to: Handover) -> None:
        """Write the limit."""
        to.p[at.MOST_TRAVEL] = self._most

    def take_back(self, block: Handover) -> None:
        """Read nothing: there is no state."""

    def findings(self) -> tuple[Finding, ...]:
        """Return nothing: what there is to say is the fault."""
        return ()

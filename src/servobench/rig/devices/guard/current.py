"""The largest current."""

from __future__ import annotations

from typing import ClassVar, Self

from servobench.core.errors import UsageError
from servobench.core.finding import Finding
from servobench.rig.devices import handover as at
from servobench.rig.devices.guard.base import MONITORS, Alarm, Motion, Rig
from servobench.rig.devices.handover import Handover


@MONITORS.member("current")
class CurrentMonitor:
    """A fault where |i| > `limits.current`, or where a sample doesn't say."""

    heading: ClassVar[str] = "Current"
    codes: ClassVar[tuple[str, ...]] = ("current-above-limit",)

    def __init__(self, limit: float) -> None:
        self._limit = limit

    @classmethod
    def of(cls, rig: Rig) -> Self | None:
        """Return a monitor where there is a limit; raises `UsageError` where the device doesn't measure its current."""
        if rig.limits.current is None:
            return None
        if rig.info.channel("current") is None:
            raise UsageError(
                f"limits.current is {rig.limits.current:g} A, but the device {rig.info.name!r} doesn't measure its current; "
                "leave that limit out"
            )
        return cls(rig.limits.current)

    @property
    def limit(self) -> str:
        """The largest current."""
        return f"at most {self._limit:g} A"

    def check(self, motion: Motion) -> Alarm | None:
        """Return an alarm where the current isn't within the limit."""
        current = motion.current
        if current is not None and -self._limit <= current <= self._limit:
            return None
        return Alarm(
            "current-above-limit",
            f"the current was {_current_text(current)}, beyond the limit of {self._limit:g} A; find out what holds the "
            "shaft, or raise limits.current",
        )

    def hand_over(self, to: Handover) -> None:
        """Write the limit."""
        to.p[at.MOST_CURRENT] = self._limit

    def take_back(self, block: Handover) -> None:
        """Read nothing: there is no state."""

    def findings(self) -> tuple[Finding, ...]:
        """Return nothing: what there is to say is the fault."""
        return ()


def _current_text(current: float | None) -> str:
    return "not measured" if current is None else f"{current:.3g} A"

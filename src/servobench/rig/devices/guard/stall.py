"""A shaft that stands still under a large voltage."""

from __future__ import annotations

from typing import ClassVar, Self

from servobench.core.finding import Finding, warning
from servobench.rig.devices import handover as at
from servobench.rig.devices.guard.base import MONITORS, Alarm, Motion, Rig
from servobench.rig.devices.handover import Handover
from servobench.rig.experiment.limits import StallLimits


@MONITORS.member("stall")
class StallMonitor:
    """A warning, then a fault, where the shaft stands under a large voltage without a break, as Quanser's amplifiers have it.

    Stalled is a shaft while |u| is above the control threshold and |ω| below the motion threshold. Where the counts of a turn
    aren't known, motion is any count in the last 50 ms. `time_stalled` [s] is how long it has been so; 0 where it isn't.
    """

    heading: ClassVar[str] = "Stall"
    codes: ClassVar[tuple[str, ...]] = ("stalled",)

    def __init__(self, limits: StallLimits, motion_threshold: float, *, by_speed: bool = True) -> None:
        self._limits = limits
        self._control, self._motion = limits.voltage, motion_threshold
        self._slow = f"was slower than {limits.motion:g} rad/s" if by_speed else "stood still"
        self.time_stalled = 0.0
        self.longest = 0.0
        """The longest time stalled in this run [s]."""
        self._warnings = 0

    @classmethod
    def of(cls, rig: Rig) -> Self | None:
        """Return a monitor where it isn't switched off, and what is put out is a voltage."""
        limits = rig.limits.stall
        if limits is None or not rig.in_volts:
            return None
        return cls(limits, limits.motion if rig.angle else 1.0, by_speed=rig.angle is not None)

    @property
    def limit(self) -> str:
        """Both thresholds and both times."""
        return (
            f"slower than {self._limits.motion:g} rad/s above {self._control:g} V: a warning after "
            f"{1000 * self._limits.warning:g} ms, cut off after {self._limits.duration:g} s"
        )

    def check(self, motion: Motion) -> Alarm | None:
        """Add to the time stalled, and return an alarm where that is too long."""
        if (
            -self._control <= motion.applied <= self._control
            or not -self._motion < motion.speed < self._motion
        ):
            self.time_stalled = 0.0
            return None
        return self._stall_alarm(motion)

    def hand_over(self, to: Handover) -> None:
        """Write the limits and the state."""
        to.p[at.STALL_VOLTAGE], to.p[at.STALL_SPEED] = self._control, self._motion
        to.p[at.STALL_WARNING], to.p[at.STALL_DURATION] = self._limits.warning, self._limits.duration
        to.s[at.STALLED], to.s[at.LONGEST_STALL] = self.time_stalled, self.longest
        to.s[at.STALL_WARNINGS] = self._warnings

    def take_back(self, block: Handover) -> None:
        """Read the state."""
        self.time_stalled, self.longest = float(block.s[at.STALLED]), float(block.s[at.LONGEST_STALL])
        self._warnings = int(block.s[at.STALL_WARNINGS])

    def findings(self) -> tuple[Finding, ...]:
        """Return a warning where the shaft was stalled for longer than `limits.stall.warning`."""
        if not self._warnings:
            return ()
        return (
            warning(
                "stalled",
                f"The shaft {self._slow} under more than {self._control:g} V, for up to {self.longest:.3g} s: find "
                "out what held it.",
            ),
        )

    def _stall_alarm(self, motion: Motion) -> Alarm | None:
        warned = self.time_stalled >= self._limits.warning
        self.time_stalled += motion.dt
        self.longest = max(self.longest, self.time_stalled)
        self._warnings += not warned and self.time_stalled >= self._limits.warning
        if self.time_stalled < self._limits.duration:
            return None
        return Alarm(
            "stalled",
            f"the shaft {self._slow} under {motion.applied:.3g} V for {self.time_stalled:.3g} s (limits: more than "
            f"{self._control:g} V, {self._limits.duration:g} s); find out what holds it",
        )

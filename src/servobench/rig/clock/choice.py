"""The choice of a clock for a device."""

from __future__ import annotations

from servobench.core.channels import Timing
from servobench.rig.clock.base import Clock, Missed, Phase
from servobench.rig.clock.device import DeviceClock
from servobench.rig.clock.host import HostClock
from servobench.rig.clock.virtual import VirtualClock


def clock_for(timing: Timing, *, missed: Missed = "discard", phase: Phase = "keep") -> Clock:
    """Return a clock for a device that leaves the time to the caller (`virtual`), to the host, or keeps it itself.

    `missed` and `phase` say what is done about ticks that have gone by (see `HostClock`). Virtual time is never late; and what
    a device that keeps the time has missed can't be had any more.
    """
    if timing == "host":
        return HostClock(missed=missed, phase=phase)
    return VirtualClock() if timing == "virtual" else DeviceClock()

"""Steps of a device's clock: times that don't fit the samples' numbers."""

from __future__ import annotations

from servobench.core.finding import Finding, warning
from servobench.core.rounding import milliseconds
from servobench.rig.clock import Tick
from servobench.rig.devices.handover import NEVER
from servobench.rig.loop.place import Place


class ClockSteps:
    """Finds jumps in the time of samples that say themselves when they were taken.

    A sample may be late by less than a sample time, so that from one to the next the time is at most a sample time off what their
    numbers say. What is off by more is a step of the clock, or its time from before a restart. (A time that goes back never gets
    here: the clock of the run refuses it.) Not for the host's clock, which can't step, but is late by whole ticks where it makes
    up for them.
    """

    def __init__(self, sample_time: float) -> None:
        self._allowed = sample_time * (1 + 1e-6)
        self._before: float | None = None
        self.found: list[tuple[float, float]] = []
        """When each step was, by the schedule, and by how much the clock jumped [s]."""

    def __call__(self, place: Place) -> None:
        """Take a tick that was done."""
        tick = place.tick
        ahead = tick.actual - tick.scheduled
        if self._before is not None and abs(ahead - self._before) > self._allowed:
            self.found.append((tick.scheduled, ahead - self._before))
        self._before = ahead

    @property
    def due(self) -> int:
        """Never: ticks that are all in time have no step."""
        return NEVER

    def pass_to(self, tick: Tick) -> None:
        """Take note that the ticks up to this one are done, in time."""
        self._before = tick.actual - tick.scheduled

    def findings(self) -> tuple[Finding, ...]:
        """Return what there is to say about it; nothing, where the clock went evenly."""
        if not self.found:
            return ()
        at, by = self.found[0]
        more = f", and {len(self.found) - 1} more times" if len(self.found) > 1 else ""
        sentence = (
            f"The device's clock jumped by {milliseconds(by)} ms at {at:g} s{more}, although no sample number was "
            "missing. The times after that are recorded as received; identify the part before it, or repeat the run."
        )
        return (warning("clock-stepped", sentence),)

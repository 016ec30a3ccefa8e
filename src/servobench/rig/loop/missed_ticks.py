"""The rule for a run that misses too many ticks: the motor is no longer under control."""

from __future__ import annotations

from collections import deque

from servobench.recordings.recording import Stopped
from servobench.rig.clock import Tick
from servobench.rig.devices.guard.base import Alarm
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.handover import NEVER
from servobench.rig.loop.place import Place
from servobench.rig.loop.ticks import Drive

FEWEST_TICKS = 10


class MissedTickRule:
    """Ends a run once more than `share` of the ticks of the last `window` seconds were missed.

    A tenth of half a second is the rule of the PR2 robot's controllers.
    It is shown each tick that is done, in order; those between two of them were missed. A window has ten ticks at least, as of
    fewer a single one would be more than a tenth. Missed ticks count one by one, so that a single long gap ends the run as well.
    """

    def __init__(self, sample_time: float, share: float = 0.1, window: float = 0.5) -> None:
        self._ticks = max(FEWEST_TICKS, round(window / sample_time))
        self._most = share * self._ticks
        self._sample_time = sample_time
        self._due = 0
        self._gaps: deque[tuple[int, int]] = deque()  # the first missed tick, and the one that came after
        self._missed = 0

    def __call__(self, place: Place) -> Stopped | None:
        """Take the tick that was done; returns None, or why the run is to end."""
        problem = self.check(place)
        if not problem:
            return None
        advice = "Use a longer sample time, or a computer or connection that keeps up"
        return Stopped(reason="fault", sentence=f"{problem}; it was stopped. {advice}")

    @property
    def due(self) -> int:
        """Never: ticks that are all in time can't end a run."""
        return NEVER

    def pass_to(self, tick: Tick) -> None:
        """Take note that the ticks up to this one are done, none of them missed."""
        self._due = tick.index
        self.count(tick.index)

    def check(self, place: Place) -> str:
        """Take the tick that was done; returns the beginning of a sentence where too many were missed, else nothing."""
        missed = self.count(place.tick.index)
        if missed <= self._most:
            return ""
        return (
            f"{missed} of the last {self._ticks} ticks ({self._ticks * self._sample_time:.3g} s) were missed at "
            f"{place.tick.scheduled:g} s, more than {self._most:g}: the motor is no longer controlled"
        )

    def begin_anew(self, due: int) -> None:
        """Forget what was missed before the tick of that number."""
        self._due, self._missed = due, 0
        self._gaps.clear()

    def count(self, index: int) -> int:
        """Take the number of a tick that is done; returns how many of the last ticks, up to it, were missed."""
        if index > self._due:
            self._gaps.append((self._due, index))
            self._missed += index - self._due
        self._due = index + 1
        if not self._gaps:
            return 0
        first = index + 1 - self._ticks  # of the window
        while self._gaps and self._gaps[0][0] < first:
            begin, end = self._gaps.popleft()
            left = max(begin, min(first, end))
            self._missed -= left - begin
            if left < end:
                self._gaps.appendleft((left, end))
                break
        return self._missed


class MissedFault:
    """The same rule where a run goes on at zero volts until a fault is acknowledged: then it latches a fault of the guard.

    While zero volts are put out anyhow there is nothing to be controlled: only ticks that were missed while the motor was driven,
    and since the last fault, count.
    """

    def __init__(self, rule: MissedTickRule, device: Guarded, drive: Drive) -> None:
        self._rule = rule
        self._device = device
        self._drive = drive

    def __call__(self, place: Place) -> Stopped | None:
        """Take the tick that was done; latches the fault, and never ends the run on "hold"."""
        if not self._drive.enabled or self._device.fault is not None:
            self._rule.begin_anew(place.tick.index + 1)
            return None
        problem = self._rule.check(place)
        if not problem:
            return None
        advice = (
            "Continue if the computer was busy for a moment; if it happens again, close other programs, or "
            "sample less often"
        )
        return self._device.refuse(Alarm("ticks-missed", f"{problem}; the voltage is set to zero. {advice}"))

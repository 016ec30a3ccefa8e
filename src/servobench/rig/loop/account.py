"""Account of a run's timing: which ticks were late, which were missed, and whether the clocks agree. Each tick is counted."""

from __future__ import annotations

from collections.abc import Callable

from servobench.core.channels import Timing
from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import milliseconds
from servobench.rig.clock import Tick
from servobench.rig.loop.pace import Spans, pace

MANY_MISSED = 0.01  # of all ticks


class Account:
    """Counts the ticks of one run as they pass, `sample_time` [s] apart by their schedule; `timing` is the clock's.

    `now` is the computer's own time [s], where a device keeps the time and the two are to be compared.
    """

    def __init__(self, sample_time: float, timing: Timing, *, now: Callable[[], float] | None = None) -> None:
        self._sample_time = sample_time
        self._timing = timing
        self._now = now if timing == "device" else None
        self._first: tuple[Tick, float] | None = None
        self._last: tuple[Tick, float] | None = None
        self._due = 0
        self.done = 0
        self.late = 0
        self.missed = 0
        self.worst = 0.0

    def add(self, tick: Tick) -> None:
        """Take a tick; those between the one that was due and this one were missed."""
        self._last = (tick, self._now() if self._now else tick.actual)
        self._first = self._first or self._last
        self.done += 1
        self.missed += tick.index - self._due
        self._due = tick.index + 1
        if tick.late:
            self.late += 1
            self.worst = max(self.worst, tick.actual - tick.scheduled)

    def add_block(self, ticks: int, last: Tick) -> None:
        """Take so many ticks up to the last one, none of them late or missed, in virtual time."""
        self._last = (last, last.actual)
        self.done += ticks
        self._due = last.index + 1

    @property
    def last(self) -> Tick | None:
        """The last tick that was done; None before the first."""
        return self._last[0] if self._last else None

    def complete(self, ticks: int | None) -> None:
        """Take note that all ticks of the run (None: no number) have gone by; what wasn't done of them at its end was missed."""
        if ticks is not None and ticks > self._due:
            self.missed += ticks - self._due
            self._due = ticks

    def findings(self) -> tuple[Finding, ...]:
        """Return what there is to say about it; nothing, where every tick came in time."""
        findings = []
        if self.late:
            findings.append(
                info(
                    "samples-late",
                    f"{self.late} of {self.done} samples were late, by up to {milliseconds(self.worst)} ms; their "
                    "actual times are recorded and used",
                )
            )
        if self.missed:
            all_ticks = self.done + self.missed
            tell = warning if self.missed > MANY_MISSED * all_ticks else info
            findings.append(
                tell(
                    "samples-missed",
                    f"{self.missed} of {all_ticks} samples were missed, as the computer or the device was busy; the "
                    "voltage was held during each gap",
                )
            )
        return (*findings, *self._pace())

    def _pace(self) -> tuple[Finding, ...]:
        """Findings on the clocks: the schedule's, the one by which samples were latched, and the samples' own."""
        if self._first is None or self._last is None:
            return ()
        (first, began), (last, ended) = self._first, self._last
        return pace(
            Spans(
                sample_time=self._sample_time,
                ticks=last.scheduled - first.scheduled,
                device=last.sample.time - first.sample.time,
                host=ended - began if self._now or self._timing == "host" else None,
                late=(last.actual - last.scheduled) - (first.actual - first.scheduled),
                handed_on=self._now is not None,
            )
        )

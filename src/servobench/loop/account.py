"""Account of a run's timing: which ticks were late, and which were missed. Each one is counted."""

from __future__ import annotations

from servobench.clock import Tick
from servobench.finding import Finding, info, warning

MANY_MISSED = 0.01  # of all ticks


class Account:
    """Counts the ticks of one run as they pass."""

    def __init__(self) -> None:
        self._due = 0
        self.done = 0
        self.late = 0
        self.missed = 0
        self.worst = 0.0

    def add(self, tick: Tick) -> None:
        """Take a tick; those between the one that was due and this one were missed."""
        self.done += 1
        self.missed += tick.index - self._due
        self._due = tick.index + 1
        if tick.late:
            self.late += 1
            self.worst = max(self.worst, tick.actual - tick.scheduled)

    def findings(self) -> tuple[Finding, ...]:
        """Return what there is to say about it; nothing, where every tick came in time."""
        findings = []
        if self.late:
            findings.append(
                info(
                    "samples-late",
                    f"{self.late} of {self.done} samples were late, by up to {1000 * self.worst:.3g} ms; "
                    f"their actual times are recorded, and used",
                )
            )
        if self.missed:
            all_ticks = self.done + self.missed
            tell = warning if self.missed > MANY_MISSED * all_ticks else info
            findings.append(
                tell(
                    "samples-missed",
                    f"{self.missed} of {all_ticks} samples were missed, as the computer or the device was busy elsewhere; "
                    f"the input before each gap held through it",
                )
            )
        return tuple(findings)

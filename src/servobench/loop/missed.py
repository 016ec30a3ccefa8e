"""The rule that ends a run which misses too many ticks: nobody controls the motor any more."""

from __future__ import annotations

from collections import deque

from servobench.loop.place import Place
from servobench.recording.recording import Stopped

FEWEST_TICKS = 10


class MissedRule:
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
        index = place.tick.index
        missed = self.missed(index)
        if missed <= self._most:
            return None
        sentence = (
            f"{missed} of the last {self._ticks} ticks ({self._ticks * self._sample_time:.3g} s) were missed at "
            f"{place.tick.scheduled:g} s, more than {self._most:g}, so that nothing controls the motor any more; it was stopped. "
            "Take a longer sample time, or a computer or connection that keeps up"
        )
        return Stopped(reason="fault", sentence=sentence)

    def missed(self, index: int) -> int:
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

"""The computer's time."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import ClassVar

from servobench.core.channels import Sample, Timing
from servobench.rig.clock.base import Missed, Phase, Tick
from servobench.rig.clock.waiting import make_waiting


class HostClock:
    """The computer's time: sleeps until shortly before each deadline, and spins for the rest.

    Tick k is due at k times the sample time T after the start, so that lateness of one tick doesn't move the next; it is counted
    from the start in whole nanoseconds, and as exact after a year as at first. A tick is late from a tenth of T on. What happens
    then is as in LabVIEW's timed loop. With the loop's last tick k - 1 done at time t, where m whole ticks have gone by since
    tick k was due, d_k + m T <= t < d_k + (m + 1) T:

    - `missed="discard"`: ticks k to k + m - 1 are missed, and never done; tick k + m is done at once. The motor never sees the
      voltages of missed ticks, which would be there for no time at all.
    - `missed="process"`: tick k is done at once and is late, none is missed. For a signal or a law that counts on every tick.
    - `phase="keep"`: whatever was late, tick j is due at j T as before. With "process", the overdue ticks follow one another
      without a pause until the schedule is caught up with; each of them is late.
    - `phase="lose"`: a tick that is late begins the schedule anew, the next is due T after it was done: `scheduled` is later
      from there on by its lateness. Two ticks are never less than T apart (but for lateness below a tenth of T), and the run
      lasts longer by all the lateness together.

    With m = 0 a late tick is done at once in all four cases, and only the phase makes a difference. Missed ticks leave their
    numbers out, late ones say so: both can be counted, whichever way it is.

    On Linux the wait is compiled, and the spin follows the wake-ups (see `Spin`); elsewhere it is `time.sleep` and a spin of
    150 µs; neither is longer than a fifth of T. `now` and `sleep` put another time in the place of the system's: `now` tells
    it [s] and never goes back, `sleep` waits for some time [s], and may take longer. The first clock of a process compiles or
    loads the wait: make it before the process goes first (`real_time`).
    """

    timing: ClassVar[Timing] = "host"

    ALLOWED_LATENESS: ClassVar[float] = 0.1
    """By which part of the sample time a tick may come after its schedule without being late."""
    LEAD_TICKS: ClassVar[int] = 5
    """Ticks that go before tick 0, so that what is slow the first time isn't late."""
    LONGEST_LEAD: ClassVar[float] = 0.05
    """The longest time that those ticks may take [s]."""

    def __init__(
        self,
        *,
        missed: Missed = "discard",
        phase: Phase = "keep",
        now: Callable[[], float] | None = None,
        sleep: Callable[[float], object] | None = None,
    ) -> None:
        self._discards = missed == "discard"
        self._keeps_phase = phase == "keep"
        self._waiting = make_waiting(now, sleep)
        self.start(1.0)

    def start(self, sample_time: float) -> None:
        """Begin; tick 0 is a few ticks ahead."""
        self._sample_time = sample_time
        # A float is a ratio of whole numbers, whose product is exact.
        self._ticks, self._nanoseconds = (Fraction(sample_time) * 1_000_000_000).as_integer_ratio()[::-1]
        self._allowed = int(self.ALLOWED_LATENESS * sample_time * 1e9)
        self._lost = 0  # ns by which the schedule was moved
        self._waiting.start(sample_time)
        lead = min(self.LEAD_TICKS * sample_time, self.LONGEST_LEAD)
        self._origin = self._waiting.now() + int(lead * 1e9)

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Wait until the tick's deadline, then latch; the actual time is that of the call."""
        due = self._due(index)
        now = self._waiting.until(due)
        whole = max(0, (now - due) * self._ticks // self._nanoseconds)
        if whole and self._discards:
            index += whole
            due = self._due(index)
        late = whole > 0 or now - due > self._allowed
        tick = Tick(
            index=index,
            scheduled=index * self._sample_time + self._lost / 1e9,
            actual=(now - self._origin) / 1e9,
            late=late,
            sample=read(),
        )
        if late and not self._keeps_phase:
            self._lost += now - due
        return tick

    def elapsed(self) -> float:
        """Return the time now [s], from the time at which tick 0 was due."""
        return (self._waiting.now() - self._origin) / 1e9

    def _due(self, index: int) -> int:
        """The time at which a tick is due, in the time of the system [ns], to the nearest."""
        span = (2 * index * self._nanoseconds + self._ticks) // (2 * self._ticks)
        return self._origin + self._lost + span

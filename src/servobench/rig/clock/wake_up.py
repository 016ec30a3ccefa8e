"""The delay with which this computer wakes a sleeping process: the limit for the lateness of a loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info
from servobench.core.rounding import microseconds, milliseconds
from servobench.rig.clock.waiting import make_waiting


@dataclass(frozen=True, kw_only=True)
class WakeUps:
    """The lateness of `count` wake-ups from sleeps of `period` [s]: median (`p50`), 99th percentile (`p99`) and largest [s]."""

    count: int
    period: float
    p50: float
    p99: float
    largest: float

    def findings(self) -> tuple[Finding, ...]:
        """Return one info that says how punctual a process can be here, without a spin."""
        p50, p99, largest = (microseconds(late) for late in (self.p50, self.p99, self.largest))
        sentence = (
            f"Before the run this computer woke the loop late by {p50} µs (median of {self.count} sleeps of "
            f"{milliseconds(self.period)} ms), {p99} µs (99th percentile) and {largest} µs (largest)."
        )
        return (info("wake-ups", sentence),)


def wake_ups(
    period: float = 1e-3,
    count: int = 200,
    *,
    now: Callable[[], float] | None = None,
    sleep: Callable[[float], object] | None = None,
) -> WakeUps:
    """Sleep `count` times until deadlines `period` [s] apart, and return how late the process was woken.

    It takes `count` times `period`, and is what `cyclictest` measures: call it in the process that is to run the loop, after
    `real_time`. `now` [s] and `sleep` put another time in the place of the system's. Raises `UsageError` for no wake-ups.
    """
    if count < 1 or period <= 0:
        raise UsageError(
            f"{count} sleeps of {period} s measure nothing; expected at least one, longer than 0 s"
        )
    waiting = make_waiting(now, sleep)
    step = round(period * 1e9)
    deadline = waiting.now()
    late = []
    for _ in range(count):
        deadline += step
        if (behind := waiting.now() - deadline) >= 0:  # slept through it: this one can't be waited for
            deadline += (behind // step + 1) * step
        late.append((waiting.sleep_until(deadline) - deadline) / 1e9)
    late.sort()
    return WakeUps(count=count, period=period, p50=_rank(late, 0.5), p99=_rank(late, 0.99), largest=late[-1])


def _rank(values: list[float], share: float) -> float:
    """The smallest of sorted values that so large a share of them doesn't exceed."""
    return values[max(0, -int(-share * len(values) // 1) - 1)]

"""Whether the clocks of a run agree: its ticks, the device's own time, and the computer's."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from servobench.core.finding import Finding, warning

# Quartz in computers and on boards is cut to 20 to 50 parts per million, and temperature and age add as much; data sheets of
# quartzes for microcontrollers (such as Abracon ABLS) put all of it together at 100. Two clocks may differ by twice that.
# A ceramic resonator, as on some small boards, is off by 5,000: that is worth a word.
QUARTZ = 100e-6
# A sample that a device hands on through a serial adapter may wait there for 16 ms (FTDI's latency timer, AN232B-04), and the
# first may wait where the last doesn't.
ON_ITS_WAY = 0.016  # s


@dataclass(frozen=True, kw_only=True)
class Spans:
    """The time from the first sample of a run to the last [s], by each clock that tells it, or None.

    `sample_time` [s] is the requested one. `ticks` is the difference of the times at which the two were due, `device` that of
    the samples' own times, `host` that of the computer's monotonic time at the two latches. `late` is how much later than the
    first the last sample came after its schedule, where the host kept the time [s], and `handed_on` says that samples are made
    elsewhere and handed on, so that the host sees them late by some milliseconds.
    """

    sample_time: float
    ticks: float
    device: float | None = None
    host: float | None = None
    late: float = 0.0
    handed_on: bool = False


def pace(spans: Spans) -> tuple[Finding, ...]:
    """Return a warning where two clocks of a run disagree by more than two good quartzes and one tick do; else nothing.

    Each end of a span is known to half a tick at best, as clocks are read at ticks: one tick. A last sample that was late is
    late by the host's clock and not by its number: so much is allowed to that clock. The rest is 200 parts per million.
    Call it at the end of a run; in virtual time with `host` only where the wall clock was shown beside the simulation.
    """
    usable = dict(_usable_clocks(spans))
    apart = [
        abs(one - other) / max(one, other)
        for (first, one), (second, other) in combinations(usable.items(), 2)
        if abs(one - other) > _tolerance(spans, {first, second}, max(one, other))
    ]
    if not apart:
        return ()
    spoken = ", ".join(f"{span:.6g} s {by}" for by, span in usable.items())
    sentence = (
        f"The run lasted {spoken}: up to {100 * max(apart):.2g} % apart, more than a tick and two quartz clocks "
        "explain. Identified times may be wrong by as much. Check for missed samples, whether the device or the "
        "simulation keeps up with its sample time, and which clock is right."
    )
    return (warning("clocks-disagree", sentence, parameters=("time_constant", "gain", "delay")),)


def _usable_clocks(spans: Spans) -> Iterator[tuple[str, float]]:
    """The clocks that tell anything: a device that has no time of its own may leave it at 0."""
    yield "by its ticks", spans.ticks
    if spans.device is not None and spans.device > 0:
        yield "by the device's own time", spans.device
    if spans.host is not None and spans.host > 0:
        yield "by the computer's clock", spans.host


def _tolerance(spans: Spans, clocks: set[str], span: float) -> float:
    allowed = spans.sample_time + 2 * QUARTZ * span
    if "by the computer's clock" in clocks:
        allowed += abs(spans.late) + (ON_ITS_WAY if spans.handed_on else 0.0)
    return allowed

"""The kind *clock*: who keeps the time of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal, Protocol, TypeAlias, runtime_checkable

from servobench.core.channels import Sample, Timing

Missed: TypeAlias = Literal["discard", "process"]
Phase: TypeAlias = Literal["keep", "lose"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tick:
    """One tick and its sample.

    `scheduled` is when it was due [s], `actual` when the sample was latched [s], in the clock's own count; a tick is due at its
    index times the sample time, later only by a clock that loses its phase. A tick is `late` where `actual` was after the
    schedule by more than is allowed, or where whole ticks had gone by when it was reached.
    """

    index: int
    scheduled: float
    actual: float
    late: bool
    sample: Sample


@runtime_checkable
class Clock(Protocol):
    """Keeps the time of one run at a time."""

    timing: ClassVar[Timing]
    """Whose time it is; a run takes it for the devices that say the same of themselves, and any for a virtual one."""

    def start(self, sample_time: float) -> None:
        """Begin a run of ticks of that length [s]; tick 0 is now or soon."""
        ...

    def latch(self, index: int, read: Callable[[], Sample]) -> Tick:
        """Wait for the tick of that index, latch its sample by calling `read`, and return both.

        Where whole ticks have gone by already, they may be missed, and the tick that comes back is a later one.
        """
        ...

    def elapsed(self) -> float:
        """Return the time now [s]: in the count in which ticks are latched, or the host's own beside a device that keeps it."""
        ...

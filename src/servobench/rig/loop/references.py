"""The reference of a controller: a signal at the scheduled times of the ticks."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.rig.clock import Tick
from servobench.systems.signals.base import Signal

BLOCK = 512  # evaluated at once: a call of a signal costs far more than one more value in it
LONG_BLOCK = 16_384  # the same for ticks that go in blocks: no motor waits
_AFRESH = 16  # the same right after the schedule was moved: that tick is late already


class References:
    """The reference at each tick, in blocks; the first at once, as a mistake should show before anything moves.

    It is the signal at the tick's scheduled time: where a clock lost its phase the rest of the run comes later, but the signal
    isn't stretched. `begin` is the tick at which the signal's own time is 0. Raises `UsageError` for values of another shape.
    """

    def __init__(self, signal: Signal, sample_time: float, begin: Tick | None = None) -> None:
        self._signal = signal
        self._sample_time = sample_time
        self._first_tick = begin.index if begin else 0
        self._moved_before = self._shift_at(begin) if begin else 0
        self._values: list[float] | None = None  # of the array, as one tick after the other takes them
        self._evaluate(self._first_tick, self._moved_before, BLOCK)

    def at(self, tick: Tick) -> float:
        """Return the reference for a tick."""
        moved = self._shift_at(tick)
        if moved != self._moved:
            self._evaluate(tick.index, moved, _AFRESH)
        elif not self._first <= tick.index < self._first + len(self._array):
            self._evaluate(tick.index, moved, BLOCK)
        if self._values is None:
            self._values = self._array.tolist()
        return self._values[tick.index - self._first]

    def block(self, index: int) -> Array:
        """Return the references from a tick on, as far as they are evaluated at once, on a schedule that wasn't moved."""
        if self._moved or not self._first <= index < self._first + len(self._array):
            self._evaluate(index, 0, LONG_BLOCK)
        return self._array[index - self._first :]

    def _shift_at(self, tick: Tick) -> int:
        """The shift of the schedule [ns]: whole ones, so that a rounding error moves nothing."""
        return round(1e9 * (tick.scheduled - tick.index * self._sample_time))

    def _evaluate(self, first: int, moved: int, count: int) -> None:
        ticks: Array = np.arange(first - self._first_tick, first - self._first_tick + count, dtype=np.float64)
        t = ticks * self._sample_time + (moved - self._moved_before) / 1e9
        values = np.asarray(self._signal(t), dtype=np.float64)
        if values.shape != t.shape:
            raise UsageError(
                f"the signal {self._signal!r} gave shape {values.shape} for times of shape {t.shape}"
            )
        self._first, self._moved = first, moved
        self._array: Array = values
        self._values = None

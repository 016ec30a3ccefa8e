"""The order of a stream's rows: gaps, repeated rows, late rows, clocks that wrapped or began again."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from servobench.core.channels import Array

Link: TypeAlias = Literal["next", "gap", "rate", "restart"]
"""A row's relation to the one before: next, after lost rows, at another rate, or the first of a clock that began again."""

_LATE = 1.5  # sample times: a longer step is a gap
_NEAR = 3.5  # sample times: a row that may follow, with two lost in between
_ALIKE = 0.2  # of a step: another rate
_OVERTAKEN = 1.0  # s; a row that is older than that isn't late, but of a clock that began again
_LATEST = 51  # steps that the rate is found from
_WRAPS = (2.0**32, 2.0**16)  # ticks of a board's clock


@dataclass
class RowOrder:
    """Judges the times of rows, one after the other; `step` is the time between two rows, `tick` the unit of the times [s].

    `lost` rows were missing in `gaps`; rows `repeated` a time, came `late`, or had a `damaged` one; there were `clock_wraps`,
    `rate_changes` and `restarts` of the clock.

    A row that jumps in time is held until the next one says whether it was a gap or a damaged digit.
    """

    step: float
    tick: float = 1.0
    lost: int = 0
    gaps: int = 0
    repeated: int = 0
    late: int = 0
    damaged: int = 0
    clock_wraps: int = 0
    rate_changes: int = 0
    restarts: int = 0
    rates: list[float] = field(default_factory=list)
    """The time between rows after each change of the rate [s]."""
    _last: float | None = field(default=None, init=False)
    _held: tuple[float, Array] | None = field(default=None, init=False)
    _wrapped: float = field(default=0.0, init=False)
    _steps: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=_LATEST), init=False)

    def take(self, t: Array, rows: Array) -> list[tuple[float, Array, Link]]:
        """Return the rows (C,) of those (N, C) at times t (N,) [s] that have a place, each with its time [s] and its link."""
        sequence: list[tuple[float, Array, Link]] = []
        for time, row in zip(t, rows, strict=True):
            self._judge(float(time) + self._wrapped, row, sequence)
        return sequence

    def _judge(self, time: float, row: Array, sequence: list[tuple[float, Array, Link]]) -> None:
        if self._was_overtaken(time) and self._held is not None:
            ahead, self._held = self._held, None
            self._judge(time, row, sequence)
            self._judge(*ahead, sequence)
            return
        time = self._settle(time, sequence)
        if self._last is None:
            self._accept(time, row, "next", sequence)
            return
        step = time - self._last
        if 0 < step <= _LATE * self.step:
            self._accept(time, row, "next", sequence)
        elif step == 0:
            self.repeated += 1
        elif (wrap := self._wrap(step)) > 0:
            self.clock_wraps += 1
            self._wrapped += wrap
            self._judge(time + wrap, row, sequence)
        elif -_OVERTAKEN < step < 0:
            self.late += 1
        else:
            self._held = time, row

    def _was_overtaken(self, time: float) -> bool:
        """Whether the row is the next one, and the row that is held came before it, as datagrams do."""
        if self._held is None or self._last is None:
            return False
        held = self._held[0] - self._last
        return 0 < time - self._last <= _LATE * self.step and time - self._last < held <= _NEAR * self.step

    def _settle(self, time: float, sequence: list[tuple[float, Array, Link]]) -> float:
        """Decide what the row that is held was, by the time of the next; returns that time."""
        if self._held is None or self._last is None:
            return time
        (held, row), self._held = self._held, None
        if self._goes_on(time, held) and self._last < held < time:
            self._accept(held, row, "gap", sequence)
            return time
        if self._follows(time, self._last) or not self._goes_on(time, held):
            self.damaged += 1
            return time
        self.restarts += 1
        self._accept(held, row, "restart", sequence)
        return time

    def _follows(self, time: float, before: float) -> bool:
        return 0 < time - before <= _NEAR * self.step

    def _goes_on(self, time: float, held: float) -> bool:
        """Whether a row goes on from one that is held: at the rate so far, or at the same new one."""
        step = held - (self._last or 0.0)
        return self._follows(time, held) or abs(time - held - step) <= _ALIKE * abs(step)

    def _wrap(self, step: float) -> float:
        """The time [s] that the board's clock lost by wrapping, 0 if it didn't: one that showed more than a width has another."""
        shown = (self._last or 0.0) - self._wrapped
        for ticks in _WRAPS:
            if shown < ticks * self.tick and 0 < step + ticks * self.tick <= _NEAR * self.step:
                return ticks * self.tick
        return 0.0

    def _accept(self, time: float, row: Array, link: Link, sequence: list[tuple[float, Array, Link]]) -> None:
        lost = 0
        if self._last is not None and link != "restart":
            lost = max(round((time - self._last) / self.step) - 1, 0) if link == "gap" else 0
            self._steps.append((time - self._last, lost))
        self.lost += lost
        self.gaps += lost > 0
        if link == "restart":
            self._steps.clear()
        elif self._rate_changed():
            link = "rate"
        self._last = time
        sequence.append((time, row, link))

    def _rate_changed(self) -> bool:
        """Whether the rate of the rows has changed; if so, the gaps that were counted because of it are taken back."""
        if len(self._steps) < _LATEST:
            return False
        median = float(np.median([step for step, _ in self._steps]))
        if abs(median - self.step) <= _ALIKE * self.step:
            return False
        self.rate_changes += 1
        self.rates.append(median)
        self.lost -= sum(lost for _, lost in self._steps)
        self.gaps -= sum(lost > 0 for _, lost in self._steps)
        self.step = median
        self._steps.clear()
        return True

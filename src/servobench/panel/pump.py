"""The thread that carries what the loop says to the panel: thirty times a second, and the page's server never waits for it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from threading import Event, Thread
from typing import Any, Protocol

import numpy as np

from servobench.channels import Array, DeviceInfo
from servobench.experiment import Experiment
from servobench.loop.messages import Command, Notice
from servobench.loop.recording_process import RecorderProcess
from servobench.loop.ring import MessageReader, RowReader, RowRing
from servobench.panel.frames import COLUMNS, Scope
from servobench.recording.recording import Recording, Stopped

FRAMES = 30.0  # a second


class Loop(Protocol):
    """What the panel needs of a loop; `LoopProcess` is one."""

    info: DeviceInfo
    recording: Recording
    ring: RowRing

    @property
    def width(self) -> int:
        """The numbers of a row that are used."""
        ...

    @property
    def ended(self) -> Stopped | None:
        """Why it ended; None while it goes on."""
        ...

    def rows(self, start: int | None = None) -> RowReader:
        """Return a reader of the rows."""
        ...

    def events(self, start: int | None = 0) -> MessageReader:
        """Return a reader of the events' texts."""
        ...

    def command(self, command: Command) -> int:
        """Give a command and return its number."""
        ...

    def here(self) -> None:
        """Show that the operator is there."""
        ...

    def record_from(
        self, first: int, path: str, experiment: Experiment, duration: float | None = None
    ) -> RecorderProcess:
        """Start a recorder of the rows from number `first` on."""
        ...

    def end_recording(self) -> None:
        """Let that recorder end."""
        ...


class Live(Protocol):
    """Identification while the motor runs; `LiveFit` is one."""

    def take(self, columns: Mapping[str, Array], first: int | None = None) -> dict[str, Any] | None:
        """Take rows in order and return a message where one is due."""
        ...

    def residuals(self, count: int) -> Array:
        """Return the next residuals [rad], NaN where there are none yet."""
        ...

    def set_wish(self, wish: Mapping[str, float] | None) -> None:
        """Say how well the parameters are to be known."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class News:
    """What came from the loop since the last look: events, and rows (N, 13) as scopes show them, the first number `first`.

    `late` and `missed` count ticks since the run began. `live` is what is known of the motor, where that is due. `ended` says why
    the run ended, once it did.
    """

    events: tuple[Notice, ...]
    first: int
    values: Array
    late: int
    missed: int
    live: dict[str, Any] | None
    ended: Stopped | None


class Pump(Thread):
    """Reads a loop's rings until `close`, and hands on what is new; `chain` is the one that the speed goes through first."""

    def __init__(
        self, loop: Loop, sample_time: float, chain: str, hand_on: Callable[[News], None], live: Live | None
    ) -> None:
        super().__init__(name="servobench pump", daemon=True)
        self._loop = loop
        self._sample_time = sample_time
        self._hand_on = hand_on
        self._live = live
        self._rows = loop.rows()
        self._events = loop.events()
        self._scope = Scope(loop.recording, chain)
        names = ["t", *(series.channel.name for series in loop.recording.series)]
        self._scheduled, self._late_flag = names.index("scheduled"), names.index("late")
        self._command = names.index("command")
        self._chains: list[tuple[int, str]] = []
        self._tick: int | None = None
        self._late = self._missed = 0
        self._over = Event()

    def run(self) -> None:
        """Look thirty times a second."""
        due = time.monotonic()
        while not self._over.is_set():
            news = self.look()
            self._hand_on(news)
            if news.ended is not None:
                return
            due = max(due + 1 / FRAMES, time.monotonic())
            self._over.wait(due - time.monotonic())

    def close(self) -> None:
        """Look no more, and wait until that is so."""
        self._over.set()
        if self.is_alive():
            self.join()

    def look(self) -> News:
        """Return what is new."""
        ended = self._loop.ended  # before the rings: what it said last is in them by then
        events = tuple(Notice.parse(text) for text in self._events.read())
        self._chains += [
            (event.about["number"], event.about["what"]["chain"])
            for event in events
            if event.kind == "command" and event.about["accepted"] and "chain" in event.about["what"]
        ]
        rows = self._rows.read()  # what is more comes with the next look
        first, values = self._rows.next - len(rows), self._shown(rows[:, : self._loop.width])
        return News(
            events=events,
            first=first,
            values=values,
            late=self._late,
            missed=self._missed,
            live=self._identified(first, values),
            ended=ended,
        )

    def _identified(self, first: int, values: Array) -> dict[str, Any] | None:
        """What is known of the motor by now, where that is due; the residuals go where they are shown."""
        if self._live is None or not len(values):
            return None
        told = self._live.take(
            {name: values[:, COLUMNS.index(name)] for name in ("t", "applied", "counts")}, first
        )
        values[:, COLUMNS.index("residual")] = self._live.residuals(len(values))
        return None if told is None else _finite(told)

    def _shown(self, rows: Array) -> Array:
        """What rows show; another chain counts from the row on that its command was in force."""
        if not len(rows):
            return self._scope.take(rows)
        self._count(rows)
        shown = []
        for number, chain in self._chains:
            until = int(np.searchsorted(rows[:, self._command], number))
            if until:
                shown.append(self._scope.take(rows[:until]))
            rows = rows[until:]
            self._scope.look_through(chain)
        self._chains = []
        return np.concatenate([*shown, self._scope.take(rows)])

    def _count(self, rows: Array) -> None:
        """Count ticks that were late, and those that were missed between two rows."""
        self._late += int(rows[:, self._late_flag].sum())
        ticks = np.rint(rows[:, self._scheduled] / self._sample_time).astype(np.int64)
        steps = np.diff(ticks, prepend=-1 if self._tick is None else self._tick)
        self._missed += int(steps.sum()) - len(ticks)
        self._tick = int(ticks[-1])


def _finite(told: Any) -> Any:
    """A message as JSON can hold it: None in the place of numbers that aren't finite, as of an interval without an end."""
    if isinstance(told, Mapping):
        return {key: _finite(value) for key, value in told.items()}
    if isinstance(told, list):
        return [_finite(value) for value in told]
    return None if isinstance(told, float) and not math.isfinite(told) else told

"""The thread that carries messages from the loop to the panel thirty times a second, so that the server never waits for them."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from threading import Thread
from typing import Any, NamedTuple, Protocol

import numpy as np

from servobench.core.channels import Array, DeviceInfo
from servobench.panel.frame_clock import FrameClock
from servobench.panel.frames import COLUMNS, Scope
from servobench.panel.kernels import count_flags
from servobench.panel.live_process import Look
from servobench.recordings.recording import Recording, Stopped
from servobench.rig.experiment import Experiment
from servobench.rig.loop.messages import Command, Notice
from servobench.rig.loop.recording_process import RecorderProcess
from servobench.rig.loop.ring import LOOP_STATE, MessageReader, RowReader, RowRing
from servobench.rig.loop.spec import ENDED

_MOST = 4096  # rows of a look; what is more comes with the next one
_RESIDUAL, _LATE, _SATURATED = (COLUMNS.index(name) for name in ("residual", "late", "saturated"))
_NOTHING_KNOWN: dict[str, Any] = {
    "kind": "live",
    "parameters": {},
    "white": None,
    "enough": False,
    "samples": 0,
}


class Loop(Protocol):
    """A loop as the panel needs it, as `LoopProcess` is: its device's info, its recording without rows, the ring of rows."""

    info: DeviceInfo
    recording: Recording
    ring: RowRing

    @property
    def ended(self) -> Stopped | None:
        """The reason why it ended; None while it goes on."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings for a person at the motor, in the order in which they came up."""
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

    def ready_recorder(self) -> None:
        """Start a recorder for the next `record_from`."""
        ...

    def record_from(
        self, first: int, path: str, experiment: Experiment, duration: float | None = None
    ) -> RecorderProcess:
        """Start a recorder of the rows from number `first` on, for a duration [s], or until `end_recording`."""
        ...

    def end_recording(self) -> None:
        """Let that recorder end."""
        ...


class Live(Protocol):
    """Identification beside the loop; `LiveProcess` is one."""

    @property
    def ended(self) -> str:
        """A sentence about how it ended by itself; empty while it hasn't."""
        ...

    def look(self) -> list[Look]:
        """Return what it has made of rows since the last look; it may be waited for a moment."""
        ...

    def message(self) -> str:
        """Return the newest message as JSON; empty where there is none since the last."""
        ...


class News(NamedTuple):
    """News from the loop since the last look: events, and the `values` of rows (N, 13) from number `first` on.

    `late` and `missed` count ticks since the run began. `limited` is the time of the last row whose voltage was limited [s], NaN
    where that is none of these. `live` is a message of what is known of the motor, as JSON, empty where none is due. `ended` says
    why the run ended, once it did.
    """

    events: tuple[Notice, ...]
    first: int
    values: Array
    late: int
    missed: int
    limited: float
    live: str
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
        self._scheduled, self._command = names.index("scheduled"), names.index("command")
        self._chains: list[tuple[int, str]] = []
        self._tick = -1
        self._late = self._missed = 0
        self._over = False

    def run(self) -> None:
        """Look thirty times a second."""
        beat = FrameClock()
        while not self._over:
            news = self.look()
            self._hand_on(news)
            if news.ended is not None:
                return
            time.sleep(beat.wait())

    def close(self) -> None:
        """Look no more, and wait until that is so."""
        self._over = True
        if self.is_alive():
            self.join()

    def look(self) -> News:
        """Return what is new."""
        ended = self._loop_end()  # before the rings: what it said last is in them by then
        events = tuple(Notice.parse(text) for text in self._events.read())
        self._chains += [
            (event.about["number"], event.about["what"]["chain"])
            for event in events
            if event.kind == "command" and event.about["accepted"] and "chain" in event.about["what"]
        ]
        looks = [] if self._live is None else self._live.look()
        rows = self._rows.read((ended is None and self._ready(looks)) or _MOST)
        first, values = self._rows.next - len(rows), self._display_rows(rows)
        _put_residuals(looks, first, values)
        late, limited = count_flags(values, _LATE, _SATURATED) if len(values) else (0, math.nan)
        self._late += late
        return News(
            events=events,
            first=first,
            values=values,
            late=self._late,
            missed=self._missed,
            limited=limited,
            live=self._identification_news(),
            ended=ended,
        )

    def _loop_end(self) -> Stopped | None:
        """The reason why the loop ended; its process is examined only where no rows come."""
        ring = self._loop.ring
        silent = ring.written == self._rows.next or ring.get(LOOP_STATE) == ENDED
        return self._loop.ended if silent else None

    def _identification_news(self) -> str:
        """News from the identification; if it has ended by itself, that, once."""
        if self._live is None:
            return ""
        if why := self._live.ended:
            self._live = None
            return json.dumps({**_NOTHING_KNOWN, "ended": why})
        return self._live.message()

    def _ready(self, looks: list[Look]) -> int:
        """The number of rows that can be shown with their residuals; 0 if none can."""
        return min(max(looks[-1].reached - self._rows.next, 0), _MOST) if looks else 0

    def _display_rows(self, rows: Array) -> Array:
        """The rows for display; a new chain applies from the row on at which its command took effect."""
        if not len(rows):
            return self._scope.take(rows)
        self._count(rows)
        shown = []
        for number, chain in self._chains:
            until = int(np.searchsorted(rows[:, self._command], number))
            if until:
                shown.append(self._scope.take(rows[:until]))
            rows = rows[until:]
            self._scope.change_chain(chain)
        self._chains = []
        last = self._scope.take(rows)
        return np.concatenate([*shown, last]) if shown else last

    def _count(self, rows: Array) -> None:
        """Count the ticks that were missed between two rows."""
        tick = round(float(rows[-1, self._scheduled]) / self._sample_time)
        self._missed += tick - self._tick - len(rows)
        self._tick = tick


def _put_residuals(looks: list[Look], first: int, values: Array) -> None:
    """Put residuals into the rows (N, 13) from number `first` on that they are of; those of other rows came too late."""
    for each in looks:
        begin = max(each.first, first)
        end = min(each.first + len(each.residuals), first + len(values))
        if begin < end:
            residuals = each.residuals[begin - each.first : end - each.first]
            values[begin - first : end - first, _RESIDUAL] = residuals

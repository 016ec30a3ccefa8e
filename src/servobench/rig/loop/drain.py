"""Takes a run's rows and events out of their rings, and writes them to a native file, with the number of missed ones."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from servobench.core.channels import Array
from servobench.core.errors import StorageError, UsageError
from servobench.core.finding import Finding, danger, info, warning
from servobench.recordings.native.mcap_file import PART
from servobench.recordings.native.writer import RecordingWriter, Together
from servobench.recordings.recording import Event, Recording, Stopped
from servobench.rig.experiment import Experiment
from servobench.rig.loop.messages import ending_from_json, info_from_json
from servobench.rig.loop.opening import opening
from servobench.rig.loop.ring import RECORD_UNTIL, ZERO_VOLTS, MessageReader, MessageRing, RowReader, RowRing

MOST_ROWS = 4096  # in a chunk
GAPS_TOLD = 3  # one by one, in a finding; each stands in the file

ROWS_MISSED = "rows-missed"
EVENTS_MISSED = "events-missed"
"""The kinds of the events that the recorder itself adds: so many rows, or events, are missing here."""

LOOP_DIED = "loop-died"
"""The code of the finding that the loop's process ended without a message."""

SILENT = Stopped(reason="error", sentence="the loop's process ended without a message")


def loop_died(rows: RowRing) -> Finding:
    """Return the finding that the loop's process ended without a message, and what its ring says of the motor."""
    if rows.get(ZERO_VOLTS):
        return info(
            LOOP_DIED,
            "The loop's process ended without a message, at zero volts: the device's last command was zero volts "
            "or a stop. Find out what ended it before the next run.",
        )
    return danger(
        LOOP_DIED,
        "The loop's process ended without a message and without writing zero volts: the motor may have kept its "
        "last voltage. Switch off the supply, then check the device's own watchdog.",
    )


class Drain:
    """Writes what is in the rings of one run to the native file `path`, from row `row` and event `event` on.

    The file is begun when the event "opened" tells which device it is, or with `begun`, what is known of a recording already.
    With `duration` [s] it is `complete` once it holds the rows that were due for so long from the first one on; without, at the
    row that the word `RECORD_UNTIL` of the ring says.
    Rows and events lost in the rings are reported by an event of their own in the file, and by a finding at its end.
    Raises what `RecordingWriter` raises.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        experiment: Experiment,
        rows: RowRing,
        events: MessageRing,
        *,
        begun: Recording | None = None,
        row: int = 0,
        event: int = 0,
        duration: float | None = None,
    ) -> None:
        self._path = path
        self._experiment = experiment
        self._ring = rows
        self._event_ring = events
        self._rows: RowReader = rows.reader(row)
        self._events: MessageReader = events.reader(event)
        self._writer = RecordingWriter(path)
        self._tick = -1
        self._time = 0.0
        self._gaps: list[tuple[int, int]] = []  # the first ones
        self._gap_count = self._rows_missed = self._events_missed = 0
        self._duration = duration
        self._due: float | None = None  # when the first row that is left out would be due [s]
        self.complete = False
        """Whether it contains the whole requested duration, although the run goes on."""
        self.begun = False
        self.rows = 0
        """The number of rows in the file."""
        self.taken = 0
        """The number of rows and events that came out of the rings so far."""
        self.ended: tuple[Stopped, tuple[Finding, ...]] | None = None
        """Why the run ended, and what was found, once the event "ended" came."""
        if begun is not None:
            self._begin(begun)

    @property
    def kept(self) -> int:
        """The number of the first row that isn't in the file yet; those before it are, or are reported as missed."""
        return self._rows.next

    def take(self) -> None:
        """Write all that is in the rings by now; an event comes before the rows that it concerns, as it was pushed before."""
        until = self._ring.written
        asked = self._ring.get(RECORD_UNTIL)
        self._take_events()
        self._take_rows(min(until, asked) if asked else until)
        self.complete = self.complete or (bool(asked) and self.kept >= asked)

    def append(self, rows: Array) -> None:
        """Write rows (N, 1 + C), which come next."""
        self._writer.append(0, rows)
        self._time = float(rows[-1, 0])
        self._tick = self._tick_of(rows[-1])
        self.rows += len(rows)
        self.taken += len(rows)

    def add(self, event: Event) -> None:
        """Write an event, which comes next; one that tells of missed rows or events counts for the findings."""
        self._writer.event(event)
        document = json.loads(event.text) if event.kind in (ROWS_MISSED, EVENTS_MISSED) else {}
        if event.kind == ROWS_MISSED:
            self._gap_count += 1
            self._rows_missed += int(document["count"])
            if len(self._gaps) < GAPS_TOLD:
                self._gaps.append((int(document["first"]), int(document["count"])))
        if event.kind == EVENTS_MISSED:
            self._events_missed += int(document["count"])
        self.taken += 1

    def end(self, stopped: Stopped, findings: tuple[Finding, ...]) -> bool:
        """End the recording, give the file its name and return True; where nothing was begun, there is no file: False.

        Nothing was begun where no device was opened, or the loop ended without a sample and without a word about a run.
        """
        if self.begun and (self.rows or self._rows_missed or self.ended is not None):
            self._writer.end(stopped, (*findings, *self._findings()))
            self._writer.close()
            return True
        self._writer.abandon()
        part_of(self._path).unlink(missing_ok=True)
        return False

    def abandon(self) -> None:
        """Leave the part as it is; never raises."""
        self._writer.abandon()

    def _begin(self, recording: Recording) -> None:
        """Begin the file with what is known; rows are of that many columns, or there is a mistake that no run should hide."""
        names = tuple(series.channel.name for series in recording.series)
        self._width = 1 + len(names)
        if self._ring.columns < self._width:
            raise UsageError(
                f"a row in the ring {self._ring.name} is {self._ring.columns} numbers; expected the time and one each for "
                f"{', '.join(names)} at least"
            )
        self._writer.begin(recording, [Together(channels=names)])
        self._scheduled = 1 + names.index("scheduled") if "scheduled" in names else None
        self.begun = True

    def _take_events(self) -> None:
        """Write the events that there are, and say where some are lost."""
        until = self._event_ring.written
        while self._events.next < until:
            before = self._events.next
            texts = self._events.read()
            lost = self._events.next - len(texts) - before
            if lost and not self.begun:
                raise StorageError(
                    f"{self._path}: the recorder started too late, {lost} events after the device was opened; "
                    "nothing was recorded. Start it before sending the first command"
                )
            if lost:
                self._write_missed(EVENTS_MISSED, before, lost)
            for text in texts:
                self._write_event(text)
            if self._events.next == before:
                break

    def _write_event(self, text: str) -> None:
        """Write an event, and understand the first and the last."""
        document = json.loads(text)
        if document["kind"] == "opened" and not self.begun:
            info = info_from_json(document["info"])
            self._begin(opening(self._experiment, info, commanded_live=True, timing=info.timing))
        if document["kind"] == "ended":
            self._take_rows(self._ring.written)  # the last word comes after the last row
            self.ended = ending_from_json(document)
        if self.begun:
            self.add(self._event(document, text))

    def _take_rows(self, until: int) -> None:
        """Write the rows up to that number, and say where some are lost."""
        while self.begun and not self.complete and self._rows.next < until:
            before = self._rows.next
            rows = self._rows.read(min(MOST_ROWS, until - before))
            lost = self._rows.next - len(rows) - before
            if lost:
                self._write_missed(ROWS_MISSED, before, lost)
            if len(rows := self._rows_within_duration(rows)):
                self.append(rows[:, : self._width])
            if self._rows.next == before:
                break

    def _rows_within_duration(self, rows: Array) -> Array:
        """The rows that were due within the duration to be recorded."""
        if self._duration is None or self._scheduled is None or not len(rows):
            return rows
        due = rows[:, self._scheduled]
        if self._due is None:
            # Half a sample time early: what is due at the end itself belongs to it no more, however it is rounded.
            self._due = float(due[0]) + self._duration - 0.5 * self._experiment.sample_time
        within = rows[due < self._due]
        self.complete = len(within) < len(rows)
        return within

    def _event(self, document: Mapping[str, Any], text: str) -> Event:
        """An event of the loop; one without a tick of its own stands where the rows are."""
        return Event(
            tick=int(document.get("tick", self._tick + 1)),
            time=float(document.get("time", self._time)),
            kind=str(document["kind"]),
            text=text,
        )

    def _write_missed(self, kind: str, first: int, count: int) -> None:
        """Write that rows or events are missing here."""
        document = {"kind": kind, "first": first, "count": count}
        self.add(self._event(document, json.dumps(document)))

    def _tick_of(self, row: Array) -> int:
        """The tick of a row: its scheduled time over the sample time."""
        if self._scheduled is None:
            return self._tick + 1
        return round(float(row[self._scheduled]) / self._experiment.sample_time)

    def _findings(self) -> tuple[Finding, ...]:
        """The rows missing from the file."""
        findings = []
        if self._rows_missed:
            places = ", ".join(f"{count} after the first {first}" for first, count in self._gaps)
            more = f" and {self._gap_count - GAPS_TOLD} more times" if self._gap_count > GAPS_TOLD else ""
            sentence = (
                f"{self._rows_missed} samples were not recorded ({places}{more}), as the recorder fell too far "
                "behind; the others keep their own times. Record to a faster disk, or more slowly."
            )
            findings.append(warning("rows-not-recorded", sentence))
        if self._events_missed:
            sentence = (
                f"{self._events_missed} events (commands, faults) were not recorded, as they came faster than the "
                "recorder could write; their effect on the samples is recorded. Send commands more slowly."
            )
            findings.append(warning("events-not-recorded", sentence))
        return tuple(findings)


def part_of(path: str | os.PathLike[str]) -> Path:
    """Return the name of a file while it is written."""
    return Path(f"{os.fspath(path)}{PART}")

"""Completes the file of a recorder that died: what it had written, and what was still in the rings."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from servobench.core.errors import FormatError, StorageError
from servobench.core.finding import Finding, info
from servobench.recordings.native.mcap_file import elsewhere_text, place_beside
from servobench.recordings.native.reader import read
from servobench.recordings.recording import Recording
from servobench.rig.experiment import read_experiment
from servobench.rig.loop.drain import (
    EVENTS_MISSED,
    MOST_ROWS,
    ROWS_MISSED,
    SILENT,
    Drain,
    loop_died,
    part_of,
)
from servobench.rig.loop.messages import ending_from_json
from servobench.rig.loop.recording_process import RecorderResult, RecorderSpec
from servobench.rig.loop.ring import RECORDER_STATE, MessageRing, RowRing

CUT_SHORT = "recording-cut-short"


def complete(spec: RecorderSpec, rows: RowRing, events: MessageRing) -> RecorderResult:
    """Write the whole file where the recorder is dead and the loop has ended: what its part holds, and the rest from the rings.

    Rows are identified by their numbers, so none is written twice and lost ones are counted: `rows-not-recorded`.
    The recording has the finding `recorder-died`. The part is removed once the file is whole, unless it can't be read and the
    rings don't hold the whole run any more.
    Raises `StorageError` where it can't be written; the part is kept then. So it does where the folder was removed meanwhile:
    what the rings held is then in another one, which the error names.
    """
    part = part_of(spec.path)
    recording = _readable(part)
    asked = Path(spec.path)
    target = asked if asked.parent.is_dir() else place_beside(asked.absolute())
    if rows.get(RECORDER_STATE) and target.exists() and not part.exists():
        # It died after it had finished: what it had begun has its name already.
        return RecorderResult(path=spec.path, rows=_rows_in(read(target)[0]))
    new = target.with_name(f"{target.stem}-completed{target.suffix}")
    drain = Drain(
        new,
        read_experiment(spec.experiment, spec.path),
        rows,
        events,
        begun=None if recording is None else _opening(recording),
        row=0 if recording is None else _rows_in(recording) + _count_missed(recording, ROWS_MISSED),
        event=0 if recording is None else _next_event(recording),
    )
    try:
        if recording is not None:
            _copy(recording, drain)
        had = drain.rows
        drain.take()
        stopped, findings = drain.ended or (SILENT, (loop_died(rows),))
        if not drain.end(stopped, (*findings, _death_finding(had, drain.rows))):
            return RecorderResult(path=None, rows=0)
    finally:
        drain.abandon()
    if _rows_in(read(new)[0]) != drain.rows:
        raise StorageError(
            f"{new} doesn't contain what was written to it; {part} is kept: copy it to another disk"
        )
    os.replace(new, target)
    # Or else it may hold rows that couldn't be read yet.
    if recording is not None or drain.rows == rows.written:
        part.unlink(missing_ok=True)
    if target != asked:
        raise StorageError(elsewhere_text(asked, target))
    return RecorderResult(path=spec.path, rows=drain.rows)


def _readable(part: Path) -> Recording | None:
    """The intact content of a part; None if there is none."""
    try:
        return read(part)[0]
    except FormatError:  # it died before it had written what device it is, if it made the part at all
        return None


def _opening(recording: Recording) -> Recording:
    """The description of a part's recording, without samples and without the remark that it was cut short."""
    nothing = np.empty(0)
    series = tuple(replace(each, values=nothing, t=nothing) for each in recording.series)
    findings = tuple(each for each in recording.findings if each.code != CUT_SHORT)
    return replace(recording, series=series, events=(), findings=findings)


def _copy(recording: Recording, drain: Drain) -> None:
    """Write what a part holds."""
    for event in recording.events:
        drain.add(event)
        if event.kind == "ended":
            drain.ended = ending_from_json(json.loads(event.text))
    t = recording.series[0].t
    rows = np.column_stack([*([] if t is None else [t]), *(each.values for each in recording.series)])
    for start in range(0, len(rows), MOST_ROWS):
        drain.append(rows[start : start + MOST_ROWS])


def _rows_in(recording: Recording) -> int:
    return len(recording.series[0].values)


def _count_missed(recording: Recording, kind: str) -> int:
    """The number of rows or events that the recorder itself had missed."""
    return sum(int(json.loads(each.text)["count"]) for each in recording.events if each.kind == kind)


def _next_event(recording: Recording) -> int:
    """The number of the first event that isn't in a part; what the recorder says itself is none of the loop's events."""
    present = sum(each.kind not in (ROWS_MISSED, EVENTS_MISSED) for each in recording.events)
    return present + _count_missed(recording, EVENTS_MISSED)


def _death_finding(had: int, rows: int) -> Finding:
    """Nothing is lost by it; what is, is a finding of its own."""
    return info(
        "recorder-died",
        f"the recorder died after {had} of {rows} samples; the other {rows - had} were still in memory and are "
        "included. Find out what ended it (such as too little memory) before the next run.",
    )

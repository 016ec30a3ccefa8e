"""The recorder: all that the loop pushed is in the file, or is told as missing; and it ends, whoever else does."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.recordings.native.reader import read
from servobench.rig.loop.drain import EVENTS_MISSED, ROWS_MISSED
from servobench.rig.loop.recording_process import LAST_WORDS, RecorderProcess, RecorderResult, record
from servobench.rig.loop.ring import LOOP_STATE, RECORDER_HEARTBEAT, RECORDER_STATE, ROWS_KEPT
from servobench.rig.loop.spec import DONE, FAILED, RECORDING
from tests.rig.loop.rings import RingLoop, ticks_of

LONGEST = 60.0  # seconds; it takes one, and a hang would take for ever


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.mcap"


def test_every_row_and_event_of_a_run_is_in_the_file(path: Path) -> None:
    with RingLoop(path) as loop:
        loop.open()
        went = record(loop.spec, loop.rows, loop.events, loop)
        state, kept = loop.rows.get(RECORDER_STATE), loop.rows.get(ROWS_KEPT)

    (recording,) = read(path)
    assert went == RecorderResult(path=str(path), rows=100)
    assert (state, kept) == (DONE, 100)
    assert ticks_of(recording).tolist() == list(range(100))
    assert [event.kind for event in recording.events] == ["opened", *["command"] * 9, "ended"]
    assert [event.tick for event in recording.events] == [0, *range(10, 100, 10), 100]
    assert (recording.stopped.reason, recording.stopped.sentence) == ("finished", "done")
    assert recording.findings == ()
    assert recording.info is not None
    assert recording.info.name == "shaft"


@pytest.mark.promise("S27")
def test_whatever_part_of_the_file_is_there_no_sample_is_without_the_events_before_it(path: Path) -> None:
    part = path.with_name("a.mcap.part")
    seen: list[tuple[int, int]] = []

    def look(waits: int) -> None:
        (recording,) = read(part)
        last = max((event.tick for event in recording.events if event.kind == "command"), default=0)
        seen.append((len(ticks_of(recording)), last))

    with RingLoop(path, ticks_a_look=7, on_wait=look) as loop:
        loop.open()
        loop.run(5)
        record(loop.spec, loop.rows, loop.events, loop)

    assert len(seen) > 10
    for rows, last_command in seen:
        assert last_command >= 10 * ((rows - 1) // 10)


def test_it_publishes_how_far_the_rows_are_safe_and_that_it_lives(path: Path) -> None:
    seen: list[tuple[int, int, int]] = []

    def look(waits: int) -> None:
        (recording,) = read(path.with_name("a.mcap.part"))
        assert loop.rows.get(ROWS_KEPT) == len(ticks_of(recording))
        seen.append(
            (loop.rows.get(RECORDER_STATE), loop.rows.get(ROWS_KEPT), loop.rows.get(RECORDER_HEARTBEAT))
        )

    with RingLoop(path, on_wait=look) as loop:
        loop.open()
        record(loop.spec, loop.rows, loop.events, loop)

    states, kept, beats = zip(*seen, strict=True)
    assert set(states) == {RECORDING}
    assert list(kept) == sorted(kept)
    assert all(a < b for a, b in pairwise(beats))


@pytest.mark.promise("S29")
def test_rows_that_the_recorder_was_too_late_for_are_counted_and_never_silent(path: Path) -> None:
    # The ring keeps 63 rows, and a look comes each 100 ticks.
    with RingLoop(path, ticks=1000, slots=64, ticks_a_look=100) as loop:
        loop.open()
        record(loop.spec, loop.rows, loop.events, loop)

    (recording,) = read(path)
    ticks = ticks_of(recording)
    gaps = np.flatnonzero(np.diff(ticks, prepend=-1) > 1)
    assert len(ticks) + sum(np.diff(ticks, prepend=-1) - 1) == 1000
    assert len(gaps) > 5
    told = [event for event in recording.events if event.kind == ROWS_MISSED]
    assert len(told) == len(gaps)
    (finding,) = recording.findings
    assert (finding.code, finding.severity) == ("rows-not-recorded", "warning")
    assert finding.sentence.startswith(f"{1000 - len(ticks)} samples were not recorded (37 after the first 0")
    assert f"and {len(gaps) - 3} more times" in finding.sentence


def test_events_that_the_recorder_was_too_late_for_are_counted(path: Path) -> None:
    # A command each 10 ticks: 10 come between two looks, and 3 are kept.
    with RingLoop(path, ticks=300, event_slots=4, ticks_a_look=100) as loop:
        loop.open()
        record(loop.spec, loop.rows, loop.events, loop)

    (recording,) = read(path)
    assert recording.findings[0].code == "events-not-recorded"
    assert EVENTS_MISSED in [event.kind for event in recording.events]
    assert len(ticks_of(recording)) == 300


@pytest.mark.promise("S22")
def test_a_loop_that_is_gone_without_a_word_leaves_a_whole_file_that_says_so(path: Path) -> None:
    with RingLoop(path) as loop:
        loop.open()
        loop.run(42)
        loop.is_gone = loop.stands = True
        record(loop.spec, loop.rows, loop.events, loop)

    (recording,) = read(path)
    assert len(ticks_of(recording)) == 42
    assert recording.stopped.reason == "error"
    assert "ended without a message" in recording.stopped.sentence
    assert [each.code for each in recording.findings] == ["loop-died"]


def test_a_loop_that_says_no_more_while_nobody_is_there_ends_the_file(path: Path) -> None:
    with RingLoop(path) as loop:
        loop.open()
        loop.run(42)
        loop.stands = loop.is_alone = True
        record(loop.spec, loop.rows, loop.events, loop)
        waits = loop.waits

    assert len(ticks_of(read(path)[0])) == 42
    assert "ended without a message" in read(path)[0].stopped.sentence
    assert waits == LAST_WORDS + 1  # the first look still finds rows


def test_a_recorder_that_is_alone_goes_on_while_the_loop_does(path: Path) -> None:
    with RingLoop(path, ticks=3 * 3 * LAST_WORDS) as loop:
        loop.open()
        loop.is_alone = True
        record(loop.spec, loop.rows, loop.events, loop)

    assert len(ticks_of(read(path)[0])) == 3 * 3 * LAST_WORDS
    assert read(path)[0].stopped.reason == "finished"


def test_a_recorder_that_is_asked_to_end_waits_for_the_last_word_and_ends_without_it(path: Path) -> None:
    with RingLoop(path, ticks=30) as loop:
        loop.open()
        loop.is_answerable = True
        record(loop.spec, loop.rows, loop.events, loop)
    assert len(ticks_of(read(path)[0])) == 30
    assert read(path)[0].stopped.reason == "finished"

    with RingLoop(path, ticks=10**6) as loop:
        loop.open()
        loop.is_answerable = True
        record(loop.spec, loop.rows, loop.events, loop)
    assert len(ticks_of(read(path)[0])) == 3 * LAST_WORDS
    assert "asked to end before the run did" in read(path)[0].stopped.sentence
    assert [each.code for each in read(path)[0].findings] == ["recorder-ended-early"]


def test_where_no_device_was_opened_there_is_no_file(path: Path) -> None:
    with RingLoop(path) as loop:
        loop.end("device_lost", "no such port")
        went = record(loop.spec, loop.rows, loop.events, loop)

    assert went == RecorderResult(path=None, rows=0)
    assert list(path.parent.iterdir()) == []


def test_where_the_loop_ended_before_a_sample_and_without_a_word_there_is_no_file(path: Path) -> None:
    with RingLoop(path) as loop:
        loop.open()
        loop.is_gone = loop.stands = True
        went = record(loop.spec, loop.rows, loop.events, loop)

    assert went == RecorderResult(path=None, rows=0)
    assert list(path.parent.iterdir()) == []


def test_an_unfinished_recording_of_that_name_is_refused_and_the_loop_hears_of_it(path: Path) -> None:
    part = path.with_name("a.mcap.part")
    part.write_bytes(b"precious")

    with RingLoop(path) as loop:
        loop.open()
        with pytest.raises(UsageError, match="unfinished recording of an earlier run"):
            record(loop.spec, loop.rows, loop.events, loop)
        state = loop.rows.get(RECORDER_STATE)

    assert state == FAILED
    assert part.read_bytes() == b"precious"


def test_a_row_that_doesn_t_fit_the_experiment_is_a_mistake_that_is_reported(path: Path) -> None:
    with RingLoop(path) as loop:
        spec = loop.spec
        with RingLoop(path) as other:
            other.device.tachometer = True
            other.open()
            loop.events = other.events
            with pytest.raises(UsageError, match=r"numbers; expected the time and one each for .*tachometer"):
                record(spec, loop.rows, other.events, loop)


def test_the_process_records_to_the_end_whatever_signals_come_and_leaves_nothing_behind(path: Path) -> None:
    with RingLoop(path, ticks=500) as loop:
        loop.open()
        loop.run(100)
        with RecorderProcess(loop.spec) as recorder:
            while not loop.rows.get(ROWS_KEPT) and recorder.running:
                pass
            os.kill(recorder.pid, signal.SIGINT)
            loop.run(100)
            os.kill(recorder.pid, signal.SIGTERM)
            loop.run(301)
            went = recorder.wait(LONGEST)
            assert not recorder.running

    assert went == RecorderResult(path=str(path), rows=500)
    assert ticks_of(read(path)[0]).tolist() == list(range(500))
    assert read(path)[0].stopped.reason == "finished"
    assert [file.name for file in path.parent.iterdir()] == ["a.mcap"]


@pytest.mark.promise("S22")
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has handles of processes")
def test_the_process_notices_that_the_loop_s_process_was_killed_before_anybody_buried_it(path: Path) -> None:
    sleeper = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    try:
        with RingLoop(path, ticks=500) as loop:
            loop.open()
            loop.run(77)
            with RecorderProcess(replace(loop.spec, loop=sleeper.pid)) as recorder:
                while loop.rows.get(ROWS_KEPT) < 77 and recorder.running:
                    pass
                sleeper.kill()
                while recorder.running:
                    pass
                assert not recorder.failed
                assert recorder.wait(LONGEST) == RecorderResult(path=str(path), rows=77)
    finally:
        sleeper.kill()
        sleeper.wait()

    assert "ended without a message" in read(path)[0].stopped.sentence


def test_a_process_that_can_t_record_says_why_in_a_sentence(path: Path) -> None:
    with RingLoop(path.with_name("missing") / "a.mcap") as loop:
        loop.open()
        loop.rows.set(LOOP_STATE, 2)
        with RecorderProcess(loop.spec) as recorder:
            went = recorder.wait(LONGEST)
        state = loop.rows.get(RECORDER_STATE)
        assert recorder.failed

    assert went.error.endswith("make it first")
    assert state == FAILED

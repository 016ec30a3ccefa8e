"""Row 17: the recorder is killed in a run. Nothing is silently unrecorded: the rest comes from memory, or is counted."""

import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import StorageError
from servobench.recordings.native.reader import read
from servobench.recordings.recording import Recording
from servobench.rig.experiment import DeviceChoice, Experiment
from servobench.rig.loop.completion import complete
from servobench.rig.loop.drain import ROWS_MISSED, Drain
from servobench.rig.loop.process import LoopProcess
from servobench.rig.loop.recording_process import INTERVAL, RECORDING, RecorderProcess, RecorderResult, record
from servobench.rig.loop.ring import RECORDER_STATE, ROWS_KEPT
from tests.rig.loop.rings import RingLoop, ticks_of

LONGEST = 60.0  # seconds; a hang would take for ever
LARGEST_LOSS = 0.1  # s of samples, before the file is completed


def killed_after(loop: RingLoop, looks: int) -> None:
    """Record by that many looks, of which the last one is followed by nothing, as after SIGKILL."""
    loop.open()
    drain = Drain(loop.spec.path, loop.experiment, loop.rows, loop.events)
    for _ in range(looks):
        loop.run(loop.ticks_a_look)
        drain.take()
    loop.rows.set(RECORDER_STATE, RECORDING)
    loop.rows.set(ROWS_KEPT, drain.kept)
    drain.abandon()


def events_of(recording: Recording) -> list[tuple[str, int]]:
    return [(event.kind, event.tick) for event in recording.events]


def all_events(ticks: int) -> list[tuple[str, int]]:
    return [("opened", 0), *(("command", tick) for tick in range(10, ticks, 10)), ("ended", ticks)]


@pytest.mark.promise("S23")
def test_a_recorder_that_is_killed_at_a_random_time_loses_nothing_once_the_file_is_completed(
    tmp_path: Path,
) -> None:
    random = np.random.default_rng(17)
    for k in range(3):
        path = tmp_path / f"{k}.mcap"
        with RingLoop(path, ticks=3000, slots=4096, event_slots=1024) as loop:
            loop.open()
            with RecorderProcess(loop.spec) as recorder:
                while loop.rows.get(RECORDER_STATE) != RECORDING and recorder.running:
                    pass
                kill_at = int(random.integers(100, 2900))
                while loop.rows.written < kill_at:
                    loop.run(10)
                os.kill(recorder.pid, signal.SIGKILL)
                went = recorder.wait(LONGEST)
            loop.run(3001)

            assert went == RecorderResult(
                path=None, rows=0, error="the recorder's process died (it was ended by signal 9)"
            )
            assert not path.exists()  # marked as not whole by its name
            assert path.with_name(f"{k}.mcap.part").exists()
            assert complete(loop.spec, loop.rows, loop.events) == RecorderResult(path=str(path), rows=3000)

        (recording,) = read(path)
        assert ticks_of(recording).tolist() == list(range(3000))
        assert events_of(recording) == all_events(3000)
        assert [finding.code for finding in recording.findings] == ["recorder-died"]
        assert "of 3000 samples" in recording.findings[0].sentence
        assert recording.stopped.reason == "finished"
        assert not path.with_name(f"{k}.mcap.part").exists()


@pytest.mark.promise("S23")
@pytest.mark.parametrize("looks", [1, 2, 7, 33])
def test_until_the_file_is_completed_the_loss_is_known_and_below_a_tenth_of_a_second(
    tmp_path: Path, looks: int
) -> None:
    path = tmp_path / "a.mcap"
    with RingLoop(path, ticks=10_000, sample_time=0.001, ticks_a_look=round(INTERVAL / 0.001)) as loop:
        killed_after(loop, looks)
        loop.run(loop.ticks_a_look)  # what comes before the look that never was
        ticks = ticks_of(read(path.with_name("a.mcap.part"))[0], 0.001)

        assert len(ticks) == loop.rows.get(ROWS_KEPT)
        assert (loop.rows.written - len(ticks)) * 0.001 <= LARGEST_LOSS


@pytest.mark.promise("S23")
def test_whatever_the_recorder_had_written_the_completed_file_holds_each_row_and_event_once(
    tmp_path: Path,
) -> None:
    """The part is cut at lengths all over it, as a kill in the middle of a write would."""
    path, part = tmp_path / "a.mcap", tmp_path / "a.mcap.part"
    with RingLoop(path) as loop:
        killed_after(loop, 20)
        loop.run(100)
        data = part.read_bytes()
        for length in [*range(0, len(data), 97), len(data)]:
            part.write_bytes(data[:length])
            path.unlink(missing_ok=True)

            assert complete(loop.spec, loop.rows, loop.events).rows == 100

            (recording,) = read(path)
            assert ticks_of(recording).tolist() == list(range(100))
            assert events_of(recording) == all_events(100)
            assert [finding.code for finding in recording.findings] == ["recorder-died"]
    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.promise("S23")
def test_what_memory_no_longer_holds_is_counted_in_the_completed_file(tmp_path: Path) -> None:
    # The ring holds 63 rows; the loop goes on without a recorder for far more.
    path = tmp_path / "a.mcap"
    with RingLoop(path, ticks=1000, slots=64) as loop:
        killed_after(loop, 10)
        loop.run(1001)
        kept = loop.rows.get(ROWS_KEPT)
        complete(loop.spec, loop.rows, loop.events)

    (recording,) = read(path)
    ticks = ticks_of(recording).tolist()
    assert ticks == [*range(kept), *range(1000 - 63, 1000)]
    assert [finding.code for finding in recording.findings] == ["recorder-died", "rows-not-recorded"]
    assert recording.findings[1].sentence.startswith(f"{1000 - 63 - kept} samples were not recorded")
    assert ROWS_MISSED in [event.kind for event in recording.events]


@pytest.mark.promise("S55")
def test_a_recorder_whose_folder_was_removed_before_it_was_killed_leaves_what_memory_holds(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    with RingLoop(folder / "a.mcap") as loop:
        killed_after(loop, 10)
        shutil.rmtree(folder)
        loop.run(101)
        with pytest.raises(StorageError, match=rf"the recording is in {tmp_path}/run-a\.mcap "):
            complete(loop.spec, loop.rows, loop.events)

    (recording,) = read(tmp_path / "run-a.mcap")
    assert ticks_of(recording).tolist() == list(range(100))


def test_a_part_that_nobody_can_read_is_kept_where_memory_does_not_hold_the_whole_run(tmp_path: Path) -> None:
    path, part = tmp_path / "a.mcap", tmp_path / "a.mcap.part"
    with RingLoop(path, ticks=1000, slots=64) as loop:
        killed_after(loop, 10)
        loop.run(1001)
        part.write_bytes(b"?" + part.read_bytes()[1:])
        complete(loop.spec, loop.rows, loop.events)

    (recording,) = read(path)
    assert ticks_of(recording).tolist() == list(range(1000 - 63, 1000))
    assert "937 samples were not recorded" in recording.findings[-1].sentence
    assert part.exists()


def test_gaps_that_the_recorder_had_itself_are_counted_once(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with RingLoop(path, ticks=600, slots=64, ticks_a_look=100) as loop:
        killed_after(loop, 3)
        loop.run(601)
        complete(loop.spec, loop.rows, loop.events)

    (recording,) = read(path)
    ticks = ticks_of(recording)
    told = next(finding for finding in recording.findings if finding.code == "rows-not-recorded")
    assert len(np.unique(ticks)) == len(ticks)
    assert told.sentence.startswith(f"{600 - len(ticks)} samples were not recorded")


def test_a_recorder_that_had_finished_before_it_was_killed_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with RingLoop(path) as loop:
        loop.open()
        record(loop.spec, loop.rows, loop.events, loop)
        before = path.read_bytes()
        assert complete(loop.spec, loop.rows, loop.events) == RecorderResult(path=str(path), rows=100)

    assert path.read_bytes() == before


@pytest.mark.promise("S23")
def test_a_real_run_whose_recorder_is_killed_stops_the_motor_and_is_recorded_to_its_last_tick(
    tmp_path: Path,
) -> None:
    endless = Experiment(
        duration=None, sample_time=0.002, device=DeviceChoice(name="twin", settings={"timing": "host"})
    )
    with LoopProcess(endless, record=tmp_path / "a.mcap") as loop:
        while loop.ring.get(ROWS_KEPT) < 100 and loop.ended is None:
            pass
        os.kill(recorder_of(loop), signal.SIGKILL)
        recording = loop.wait()
        written = loop.ring.written

    assert recording.stopped.reason == "error"
    assert "recorder" in recording.stopped.sentence
    assert "recorder-died" in [finding.code for finding in recording.findings]
    ticks = np.rint(recording["scheduled"].values / 0.002).astype(int)
    assert len(ticks) == len(np.unique(ticks)) == written
    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap"]


def recorder_of(loop: LoopProcess) -> int:
    """The number of the recorder's process."""
    assert loop._recording is not None
    return loop._recording[0].pid

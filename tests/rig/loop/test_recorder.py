"""Rows on their way to a file: the loop never waits for a disk, and hears when there is no way."""

from collections.abc import Iterator
from pathlib import Path
from threading import Event

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import StorageError
from servobench.recordings.native.reader import read
from servobench.recordings.native.writer import RecordingWriter
from servobench.recordings.recording import Recording, Series, Source, Stopped
from servobench.rig.loop.recorder import InMemory, Recorder, ToFile

NOTHING = np.empty(0)
OPENING = Recording(
    name="run",
    series=tuple(Series(channel=Channel(name=name, unit="V"), values=NOTHING, t=NOTHING) for name in "ab"),
    source=Source(name="twin"),
)
ENDED = Stopped(reason="finished", sentence="done")


@pytest.fixture
def hanging_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Event]:
    """Let writing hang until the event is set."""
    awake = Event()
    append = RecordingWriter.append

    def wait(self: RecordingWriter, group: int, rows: np.ndarray) -> None:
        awake.wait()
        append(self, group, rows)

    monkeypatch.setattr(RecordingWriter, "append", wait)
    yield awake
    awake.set()


def fill(recorder: Recorder, blocks: int) -> None:
    for block in range(blocks):
        recorder.append(np.full((2, 3), float(block)))


@pytest.mark.parametrize("blocks", [0, 1, 200])
def test_a_file_and_memory_give_the_same(tmp_path: Path, blocks: int) -> None:
    found = []
    for recorder in (InMemory(OPENING), ToFile(OPENING, tmp_path / "a.mcap", patience=10)):
        fill(recorder, blocks)
        found.append(recorder.end(ENDED, ()))
        recorder.abandon()

    assert found[0] == found[1]
    assert found[0]["b"].values.tolist() == np.repeat(np.arange(float(blocks)), 2).tolist()


def test_a_disk_that_hangs_is_reported_to_a_loop_that_can_not_wait(
    tmp_path: Path, hanging_disk: Event
) -> None:
    recorder = ToFile(OPENING, tmp_path / "a.mcap", patience=0)

    with pytest.raises(StorageError, match=r"doesn't keep up .* kept in \(a\.mcap\.part\)"):
        fill(recorder, 1000)

    hanging_disk.set()
    recorder.abandon()
    # All that it had taken over is written, once the disk is awake: 64 blocks that waited and the one that hung.
    assert len(read(tmp_path / "a.mcap.part")[0]["a"].values) in (2 * 64, 2 * 65)


def test_a_loop_in_virtual_time_waits_for_the_disk(tmp_path: Path, hanging_disk: Event) -> None:
    recorder = ToFile(OPENING, tmp_path / "a.mcap", patience=60)
    fill(recorder, 64)
    hanging_disk.set()
    fill(recorder, 1000)

    assert len(recorder.end(ENDED, ())["a"].values) == 2 * 1064


def test_what_fails_while_writing_is_raised_by_the_next_rows_or_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(self: RecordingWriter, group: int, rows: np.ndarray) -> None:
        raise StorageError("no space")

    monkeypatch.setattr(RecordingWriter, "append", fail)
    recorder = ToFile(OPENING, tmp_path / "a.mcap", patience=10)
    recorder.append(np.ones((2, 3)))

    with pytest.raises(StorageError, match="no space"):
        recorder.end(ENDED, ())

    later = ToFile(OPENING, tmp_path / "b.mcap", patience=10)
    with pytest.raises(StorageError, match="no space"):
        fill(later, 10_000)  # hears of it as soon as the thread has seen the first; never waits for a place
    later.abandon()


def test_what_is_abandoned_stays_readable(tmp_path: Path) -> None:
    recorder = ToFile(OPENING, tmp_path / "a.mcap", patience=10)
    fill(recorder, 5)
    recorder.abandon()
    recorder.abandon()

    assert len(read(tmp_path / "a.mcap.part")[0]["a"].values) == 10


def test_rows_that_are_kept_stand_while_more_come() -> None:
    """Also where there was no room for them."""
    recorder = InMemory(OPENING, expected=3)
    fill(recorder, 1)
    first = recorder.end(ENDED, ())["a"].values
    fill(recorder, 5)

    assert first.tolist() == [0.0, 0.0]
    assert recorder.end(ENDED, ())["a"].values.tolist() == [0.0, 0.0, *np.repeat(np.arange(5.0), 2)]


def test_a_run_of_a_thousand_years_takes_no_memory_before_it_begins() -> None:
    recorder = InMemory(OPENING, expected=10**15)
    fill(recorder, 2)

    assert len(recorder.end(ENDED, ())["a"].values) == 4

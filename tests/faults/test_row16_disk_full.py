"""Row 16: the disk is full in a run. The motor stops first, then the file is closed; what was written can be read."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from servobench.core.errors import StorageError
from servobench.recordings.native import mcap_file
from servobench.recordings.native.reader import read
from servobench.recordings.native.recover import recover
from servobench.rig.experiment import DeviceChoice, Experiment, WhenLate
from servobench.rig.loop.process import LoopProcess
from servobench.rig.loop.recording_process import FAILED, RecorderProcess, record
from servobench.rig.loop.ring import RECORDER_STATE, ROWS_KEPT
from tests.faults.test_row17_recorder_killed import recorder_of
from tests.recordings.native.disks import FullDisk
from tests.rig.loop.rings import RingLoop, ticks_of

LONGEST = 60.0  # seconds; a hang would take for ever


@pytest.mark.promise("S24")
@pytest.mark.parametrize("room", [3500, 5000, 8000, 12_345])
def test_the_motor_stands_before_the_file_is_closed_and_after_one_tick(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    path = tmp_path / "a.mcap"
    with RingLoop(path, ticks=10_000) as loop:

        class Watched(FullDisk):
            """Notes what the motor does while the file is closed, and how many rows there were when a write failed."""

            failed_after = -1

            def write(self, data: bytes) -> int:
                try:
                    return super().write(data)
                except OSError:
                    Watched.failed_after = loop.rows.written
                    raise

            def close(self) -> None:
                loop.device.events.append(f"closed at {loop.device.voltage:g} V")
                self._file.close()

        monkeypatch.setattr(mcap_file, "open", lambda path, mode: Watched(path, mode, room), raising=False)
        loop.open()
        loop.run(1)
        assert loop.device.voltage == 2.0
        with pytest.raises(StorageError, match=r"No space left on device; .*\(servobench recover makes"):
            record(loop.spec, loop.rows, loop.events, loop)
        kept = loop.rows.get(ROWS_KEPT)

    assert loop.device.events == ["start", "stop", "closed at 0 V"]
    # Not one more row: in the first tick after the failure the loop put out zero volts in place of the next one.
    assert loop.failed_at == Watched.failed_after
    monkeypatch.undo()
    (found,) = recover(tmp_path / "a.mcap.part", tmp_path / "b.mcap")
    ticks = ticks_of(found)
    assert ticks.tolist() == list(range(len(ticks)))
    # The chunk that the disk had no room for is lost, or is there and only its index isn't; no more than 30 ms in real time.
    assert kept <= len(ticks) <= kept + loop.ticks_a_look
    assert loop.failed_at - len(ticks) <= loop.ticks_a_look
    assert found.findings[-1].code == "recording-cut-short"


@pytest.mark.promise("S24")
def test_a_loop_that_goes_on_does_not_keep_the_recorder_from_closing_the_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_file, "open", lambda path, mode: FullDisk(path, mode, 5000), raising=False)
    with RingLoop(tmp_path / "a.mcap", ticks=10**6, stops_where_recording_fails=False) as loop:
        loop.open()
        with pytest.raises(StorageError, match="No space left"):
            record(loop.spec, loop.rows, loop.events, loop)
        assert loop.rows.get(RECORDER_STATE) == FAILED
        assert loop.device.voltage == 2.0

    assert len(ticks_of(read(tmp_path / "a.mcap.part")[0])) > 0


@contextmanager
def small_disk(folder: Path, size: int, how: str) -> Iterator[Callable[[int], None]]:
    """Let files in a folder grow to `size` bytes at most; gives what has to be called with the number of who writes there.

    A "disk" is a file system of its own, where that is permitted. Anybody may set a "limit", as `ulimit -f` does.
    """
    mounted = how == "disk" and not subprocess.call(
        ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], stderr=subprocess.DEVNULL
    )

    def limit(process: int) -> None:
        import resource

        if not mounted:
            resource.prlimit(process, resource.RLIMIT_FSIZE, (size, size))

    try:
        yield limit
    finally:
        if mounted:
            subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.promise("S24")
@pytest.mark.skipif(sys.platform != "linux", reason="mounts, and limits of another process")
@pytest.mark.parametrize("how", ["disk", "limit"])
def test_a_recorder_on_a_disk_that_really_is_full_tells_the_loop_and_leaves_what_it_wrote(
    tmp_path: Path, how: str
) -> None:
    folder = tmp_path / "small"
    folder.mkdir()
    path = folder / "a.mcap"
    with small_disk(folder, 1 << 18, how) as limit, RingLoop(path, ticks=10**6, slots=1 << 16) as loop:
        loop.open()
        with RecorderProcess(loop.spec) as recorder:
            limit(recorder.pid)
            # No faster than the recorder writes, so that the disk is filled before the ring has gone round.
            while loop.failed_at is None and recorder.running:
                if (
                    loop.rows.get(RECORDER_STATE) == FAILED
                    or loop.rows.written - loop.rows.get(ROWS_KEPT) < 1000
                ):
                    loop.run(100)
            went = recorder.wait(LONGEST)
        kept = loop.rows.get(ROWS_KEPT)
        (found,) = read(folder / "a.mcap.part")

    assert loop.device.events[-1] == "stop"
    assert loop.device.voltage == 0.0
    assert "can't be written any further" in went.error
    assert "servobench recover" in went.error
    ticks = ticks_of(found)
    assert ticks.tolist() == list(range(len(ticks)))
    assert len(ticks) >= kept > 1000


@pytest.mark.promise("S24")
@pytest.mark.skipif(sys.platform != "linux", reason="mounts, and limits of another process")
@pytest.mark.parametrize("how", ["disk", "limit"])
def test_a_real_run_on_a_disk_that_is_full_ends_with_a_sentence_and_keeps_what_it_wrote(
    tmp_path: Path, how: str
) -> None:
    folder = tmp_path / "small"
    folder.mkdir()
    # On a busy machine too many missed ticks would end the run before the disk is full: here none are missed, only late.
    endless = Experiment(
        duration=None,
        sample_time=0.002,
        device=DeviceChoice(name="twin", settings={"timing": "host"}),
        when_late=WhenLate(phase="lose"),
    )
    with (
        small_disk(folder, 1 << 16, how) as limit,
        LoopProcess(endless, record=folder / "a.mcap") as loop,
    ):
        limit(recorder_of(loop))
        with pytest.raises(StorageError, match=r"can't be written any further.*servobench recover"):
            loop.wait()
        stopped, written, kept = loop.ended, loop.ring.written, loop.ring.get(ROWS_KEPT)
        last = loop.rows(written - 1).read()[0]
        names = [series.channel.name for series in loop.recording.series]
        (found,) = read(folder / "a.mcap.part")

    assert stopped is not None
    assert stopped.reason == "error"
    assert len(found["counts"].values) >= kept > 0
    # What is in the part is what the run had, up to a row of it.
    assert last[1 + names.index("scheduled")] >= found["scheduled"].values[-1]

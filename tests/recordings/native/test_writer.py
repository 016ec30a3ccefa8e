"""A written file can be read: by us, equal to the bit, and by the standard reader, with all its checks."""

import itertools
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, make_reader

from servobench.core.errors import StorageError, UsageError
from servobench.recordings.native import mcap_file
from servobench.recordings.native.reader import read
from servobench.recordings.native.writer import RecordingWriter, save
from servobench.recordings.recording import Recording, Source, Stopped
from tests.recordings.native.disks import FullDisk
from tests.recordings.native.samples import TOGETHER, opening, recordings, series, small

ENDED = Stopped(reason="finished", sentence="done")


@given(st.lists(recordings(), min_size=1, max_size=3))
def test_any_recordings_come_back_equal(
    tmp_path_factory: pytest.TempPathFactory, given_ones: list[Recording]
) -> None:
    path = tmp_path_factory.mktemp("any") / "a.mcap"

    save(given_ones, path)

    assert read(path) == tuple(given_ones)


def test_every_bit_of_a_number_comes_back(tmp_path: Path) -> None:
    # NaN equals NaN and 0 equals -0 for Recording; here the bits are held, a signalling NaN with a payload among them.
    bits = np.array([0x7FF0000000000001, 0x8000000000000000, 1, 0xFFF8000000000123], dtype=np.uint64)
    path = tmp_path / "a.mcap"

    save(
        [
            Recording(
                name="r",
                series=(series("x", bits.view(np.float64), bits.view(np.float64)),),
                source=Source(name=""),
            )
        ],
        path,
    )

    found = read(path)[0]["x"]
    assert found.t is not None
    assert [found.values.view(np.uint64).tolist(), found.t.view(np.uint64).tolist()] == [bits.tolist()] * 2


@given(st.lists(recordings(), min_size=1, max_size=3))
def test_the_standard_reader_takes_any_file_of_ours(
    tmp_path_factory: pytest.TempPathFactory, given_ones: list[Recording]
) -> None:
    path = tmp_path_factory.mktemp("any") / "a.mcap"
    save(given_ones, path)
    samples = sum(len(values) for values in _columns_by_topic(path).values())

    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        metadata = [each.name for each in reader.iter_metadata()]
        file.seek(0)
        # The one that doesn't seek also holds the checksum over the whole data section.
        counted = sum(1 for _ in NonSeekingReader(file, validate_crcs=True).iter_messages())

    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == counted == samples
    kinds = ["servobench.recording/1", "servobench.recording.event/1", "servobench.recording.end/1"]
    assert metadata == [
        kind
        for each in given_ones
        for kind, times in zip(kinds, (1, len(each.events), 1), strict=True)
        for _ in range(times)
    ]


def _columns_by_topic(path: Path) -> dict[str, list[list[float]]]:
    """The messages of each topic, read by the standard reader and decoded by the rules of CDR."""
    found: dict[str, list[list[float]]] = {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(
            log_time_order=False
        ):
            assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg")
            assert message.data[:4] == b"\0\1\0\0"  # little-endian, no options
            rows = found.setdefault(channel.topic, [])
            assert message.sequence == len(rows)
            rows.append(np.frombuffer(message.data[4:], "<f8").tolist())
    return found


def test_the_standard_reader_finds_the_same_values_at_the_same_times(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recording = small(samples=5000)  # more than one chunk

    save([recording], path)

    t = recording["counts"].t
    assert t is not None
    columns = np.array(_columns_by_topic(path)["/run/samples"]).T
    assert np.array_equal(columns, [t, recording["applied"].values, recording["counts"].values])
    with open(path, "rb") as file:
        reader = make_reader(file)
        times = [m.log_time for _, c, m in reader.iter_messages() if c.topic == "/run/samples"]
        schema = next(s.data.decode() for s in reader.get_summary().schemas.values())
    assert times == [2_000_000 * k for k in range(5000)]
    assert schema == "float64 t  # time [s]\nfloat64 applied  # applied [V]\nfloat64 counts  # counts [V]\n"


def test_names_that_are_none_for_ros_become_some_and_stay_apart(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    names = ("ω", "θ", "t", "2nd", "Speed [rad/s]", "speed rad s", "a\nfloat64 b")

    save(
        [
            Recording(
                name="Übung 1.csv",
                series=tuple(series(n, [1.0], [0.0]) for n in names),
                source=Source(name=""),
            )
        ]
        * 2,
        path,
    )

    with open(path, "rb") as file:
        summary = make_reader(file).get_summary()
    lines = next(iter(summary.schemas.values())).data.decode().splitlines()
    fields = [line.split()[1] for line in lines]
    assert fields == [
        "t",
        "channel",
        "channel_2",
        "t_2",
        "channel_2nd",
        "speed_rad_s",
        "speed_rad_s_2",
        "a_float64_b",
    ]
    assert [channel.topic for channel in summary.channels.values()] == [
        "/bung_1_csv/samples",
        "/bung_1_csv/samples_2",
    ]


def test_negative_times_are_kept_and_their_log_times_count_from_a_whole_second_before(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recording = Recording(
        name="r", series=(series("x", [1.0, 2.0, 3.0], [-0.5, np.nan, 0.25]),), source=Source(name="")
    )

    save([recording], path)

    assert read(path) == (recording,)
    with open(path, "rb") as file:
        messages = list(make_reader(file, validate_crcs=True).iter_messages(log_time_order=False))
    assert [message.log_time for _, _, message in messages] == [500_000_000, 0, 1_250_000_000]


def test_no_recordings_are_refused_and_leave_no_file(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no recording to write"):
        save([], tmp_path / "a.mcap")
    assert list(tmp_path.iterdir()) == []


def test_an_earlier_file_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    save([small("old")], path)

    with RecordingWriter(path) as writer:
        writer.begin(opening("new"), TOGETHER)
        assert read(path)[0].name == "old"
        writer.end(ENDED)

    assert read(path)[0].name == "new"
    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap"]


def test_the_part_of_an_earlier_run_is_never_overwritten(tmp_path: Path) -> None:
    part = tmp_path / "a.mcap.part"
    part.write_bytes(b"precious")

    with pytest.raises(UsageError, match="recover"):
        save([small()], tmp_path / "a.mcap")
    assert part.read_bytes() == b"precious"


@pytest.mark.parametrize("name", ["", "missing/a.mcap", "a\0b"])
def test_a_place_that_is_no_file_in_a_folder_is_refused_before_anything_is_recorded(
    tmp_path: Path, name: str
) -> None:
    with pytest.raises(UsageError, match=r"name of a file|no folder .*missing; make it first"):
        RecordingWriter(tmp_path / name)


def test_an_error_leaves_a_part_that_can_be_read(tmp_path: Path) -> None:
    def fail() -> None:
        with RecordingWriter(tmp_path / "a.mcap") as writer:
            writer.begin(opening(), TOGETHER)
            writer.append(0, np.ones((4, 3)))
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()

    assert [file.name for file in tmp_path.iterdir()] == ["a.mcap.part"]
    assert read(tmp_path / "a.mcap.part")[0]["counts"].values.tolist() == [1.0] * 4


@pytest.mark.parametrize("room", [0, 20, 3000, 12_000])
def test_a_full_disk_keeps_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    monkeypatch.setattr(mcap_file, "open", lambda path, mode: FullDisk(path, mode, room), raising=False)
    blocks = 0

    def fill() -> None:
        nonlocal blocks
        with RecordingWriter(tmp_path / "a.mcap") as writer:
            writer.begin(opening(), TOGETHER)
            while True:
                writer.append(0, np.full((10, 3), float(blocks)))
                blocks += 1

    with pytest.raises(StorageError, match=r"No space left on device; .* is kept in .*a\.mcap\.part"):
        fill()

    assert bool(blocks) == (room >= 3000)
    if blocks:
        found = read(tmp_path / "a.mcap.part")[0]["counts"].values
        # Of the block that failed, the samples may be there and only their index not.
        assert len(found) // 10 in (blocks, blocks + 1)
        assert np.array_equal(found, np.repeat(np.arange(len(found) // 10), 10))


@pytest.mark.promise("S25")
def test_the_disk_itself_is_reached_about_once_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seconds = iter(np.arange(0.0, 100.0, 0.25).tolist())
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", synced.append)

    # One look at the clock for the start, one for each of: head, opening, two schemas, two channels, 40 blocks.
    with RecordingWriter(tmp_path / "a.mcap", now=lambda: next(seconds)) as writer:
        writer.begin(opening(), TOGETHER)
        for _ in range(40):
            writer.append(0, np.ones((1, 3)))

        assert len(synced) == 46 // 4
        writer.end(ENDED)


def test_a_killed_process_loses_nothing_of_what_append_was_given(tmp_path: Path) -> None:
    program = f"""
import sys, numpy as np
from servobench.recordings.native.writer import RecordingWriter
from tests.recordings.native.disks import FullDisk
from tests.recordings.native.samples import TOGETHER, opening
writer = RecordingWriter({str(tmp_path / "a.mcap")!r})
writer.begin(opening(), TOGETHER)
for block in range(10**9):
    writer.append(0, np.full((10, 3), float(block)))
    print(block, flush=True)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, cwd=Path(__file__).parents[3]
    )
    assert process.stdout is not None
    for _ in range(50):
        last = process.stdout.readline()
    process.kill()
    process.wait()
    process.stdout.close()

    found = read(tmp_path / "a.mcap.part")[0]["counts"].values
    assert len(found) >= 10 * (int(last) + 1)
    assert np.array_equal(found, np.repeat(np.arange(len(found) // 10), 10))


def seconds() -> Callable[[], float]:
    """A clock that goes on by a second each time that it is looked at."""
    return itertools.count().__next__


def append(writer: RecordingWriter, first: int, end: int) -> None:
    number = np.arange(first, end)
    writer.append(0, np.column_stack([0.01 * number, number, number]))


@pytest.mark.promise("S55")
@pytest.mark.skipif(sys.platform == "win32", reason="an open file can't be taken away there")
@pytest.mark.parametrize("how", ["removed", "renamed"])
def test_a_file_whose_folder_is_taken_away_goes_on_in_the_next_one_above(tmp_path: Path, how: str) -> None:
    folder = tmp_path / "runs" / "run"
    folder.mkdir(parents=True)
    writer = RecordingWriter(folder / "a.mcap", now=seconds())
    writer.begin(opening(), TOGETHER)
    append(writer, 0, 10)
    if how == "removed":
        shutil.rmtree(tmp_path / "runs")
    else:
        folder.rename(tmp_path / "other")
    append(writer, 10, 20)

    saved = tmp_path / "run-a.mcap" if how == "removed" else tmp_path / "runs" / "run-a.mcap"
    (found,) = read(f"{saved}.part")  # at once, so that it outlives this process from here on
    assert found.series[0].values.tolist() == list(range(20))

    append(writer, 20, 30)
    writer.end(ENDED)
    with pytest.raises(
        StorageError, match=rf"a\.mcap was removed or renamed .* is in {re.escape(str(saved))} "
    ):
        writer.close()
    (found,) = read(saved)
    assert found.series[0].values.tolist() == list(range(30))
    assert found.stopped == ENDED


@pytest.mark.promise("S55")
@pytest.mark.skipif(sys.platform == "win32", reason="an open file can't be taken away there")
def test_a_folder_that_is_taken_away_just_before_the_end_costs_nothing_either(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    # Names that are taken are left alone, also that of a recording which is being written.
    (tmp_path / "run-a.mcap").touch()
    (tmp_path / "run-a-2.mcap.part").touch()
    writer = RecordingWriter(tmp_path / "run" / "a.mcap", now=lambda: 0.0)
    writer.begin(opening(), TOGETHER)
    append(writer, 0, 10)
    writer.end(ENDED)
    shutil.rmtree(tmp_path / "run")

    with pytest.raises(StorageError, match="run-a-3"):
        writer.close()
    assert read(tmp_path / "run-a-3.mcap")[0].series[0].values.tolist() == list(range(10))


@pytest.mark.promise("S55")
@pytest.mark.skipif(sys.platform == "win32", reason="an open file can't be taken away there")
def test_a_file_that_alone_is_taken_away_is_written_again(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap", now=seconds()) as writer:
        writer.begin(opening(), TOGETHER)
        append(writer, 0, 10)
        (tmp_path / "a.mcap.part").unlink()
        append(writer, 10, 20)
        writer.end(ENDED)

    assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]
    assert read(tmp_path / "a.mcap")[0].series[0].values.tolist() == list(range(20))


def test_rows_of_another_width_are_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        writer.begin(opening(), TOGETHER)
        with pytest.raises(UsageError, match=r"/run/samples: rows of shape \(2, 5\); expected \(N, 3\)"):
            writer.append(0, np.ones((2, 5)))


def test_rows_before_a_recording_has_begun_are_refused(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer, pytest.raises(UsageError, match="begin"):
        writer.append(0, np.ones((2, 5)))


def test_a_recording_begins_when_the_one_before_has_ended_and_each_channel_has_a_place(
    tmp_path: Path,
) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        with pytest.raises(UsageError, match="these channels have a place in the file: 'applied', 'counts'"):
            writer.begin(opening(), TOGETHER[:1])
        writer.begin(opening("one"), TOGETHER)
        with pytest.raises(UsageError, match="'one' has to end before 'two' begins"):
            writer.begin(opening("two"), TOGETHER)


def test_a_closed_file_takes_nothing_more_and_stays_whole(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        writer.begin(opening(), TOGETHER)
        writer.end(ENDED)
        writer.close()
        with pytest.raises(UsageError, match="is closed"):
            writer.begin(opening(), TOGETHER)

    assert len(read(tmp_path / "a.mcap")) == 1


def test_more_channels_than_a_file_can_number_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_file, "MOST_NUMBERS", 3)

    with pytest.raises(UsageError, match="at most 3 channels"):
        save([small()] * 2, tmp_path / "a.mcap")

"""A file that isn't as it was written gives what is right in it, or an error of ours; never a wrong value."""

import random
import struct
import tracemalloc
import zlib
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.writer import Writer

from servobench.core.errors import FormatError
from servobench.recordings.native import mcap
from servobench.recordings.native.description import OPENING, Group, Opening, entries
from servobench.recordings.native.reader import read
from servobench.recordings.native.writer import RecordingWriter, save
from servobench.recordings.recording import Recording, Source
from tests.files import refill
from tests.recordings.native.samples import TOGETHER, opening, small


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[bytes, tuple[Recording, ...]]:
    """Return a file of two recordings, the first in two chunks, and what it holds."""
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    with RecordingWriter(path) as writer:
        first = small("first", samples=4)
        writer.begin(opening("first"), TOGETHER)
        rows = np.column_stack([first["counts"].t, first["applied"].values, first["counts"].values])
        writer.event(first.events[0])
        writer.append(0, rows[:2])
        writer.event(first.events[1])
        writer.append(0, rows[2:])
        writer.append(1, first["notes"].values[:, None])
        writer.end(first.stopped, first.findings)
        second = replace(opening("second"), findings=(), events=())
        writer.begin(second, TOGETHER)
        writer.end(second.stopped)
    return path.read_bytes(), (first, second)


def holds_nothing_wrong(path: Path, data: bytes, originals: tuple[Recording, ...]) -> bool:
    """Read those bytes: True where that gives the originals, a beginning of them with its finding, or an error of ours."""
    refill(path, data)
    try:
        found = read(path)
    except FormatError:
        return True
    if found == originals:
        return True
    *complete, last = found
    original = originals[len(complete)]
    return (
        tuple(complete) == originals[: len(complete)]
        and last.findings[-1].code == "recording-cut-short"
        and last.findings[:-1] == original.findings
        and all(is_beginning(last, original, each.channel.name) for each in original.series)
        and last.events == original.events[: len(last.events)]
        and replace(
            last, series=(), findings=(), stopped=original.stopped, input=None, output=None, events=()
        )
        == replace(original, series=(), findings=(), input=None, output=None, events=())
    )


def is_beginning(of: Recording, original: Recording, name: str) -> bool:
    """Whether a series holds the first samples of the original, and no other."""
    found, all_of_it = of[name], original[name]
    part = slice(len(found.values))
    t = None if all_of_it.t is None else all_of_it.t[part]
    return found == replace(all_of_it, values=all_of_it.values[part], t=t)


@pytest.mark.promise("S27")
def test_a_file_cut_after_any_byte_gives_its_beginning(
    tmp_path: Path, whole: tuple[bytes, tuple[Recording, ...]]
) -> None:
    data, originals = whole

    assert [n for n in range(len(data)) if not holds_nothing_wrong(tmp_path / "a", data[:n], originals)] == []


@pytest.mark.promise("S27")
def test_the_more_of_a_file_is_there_the_more_samples_it_gives(
    tmp_path: Path, whole: tuple[bytes, tuple[Recording, ...]]
) -> None:
    data, _ = whole
    samples = [_samples(tmp_path / "a", data[:n]) for n in range(len(data) + 1)]

    assert samples == sorted(samples)
    assert sorted(set(samples)) == [
        -1,
        0,
        2,
        4,
        6,
    ]  # -1 is an error; the notes without times are the last two


def _samples(path: Path, data: bytes) -> int:
    refill(path, data)
    try:
        return sum(len(r["counts"].values) + len(r["notes"].values) for r in read(path))
    except FormatError:
        return -1


@pytest.mark.promise("S26")
def test_a_flipped_bit_is_never_taken_for_a_value(
    tmp_path: Path, whole: tuple[bytes, tuple[Recording, ...]]
) -> None:
    data, originals = whole

    wrong = []
    for place in range(len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 1 << place % 8
        if not holds_nothing_wrong(tmp_path / "a", bytes(damaged), originals):
            wrong.append(place)

    assert wrong == []


@pytest.mark.promise("S26")
def test_bytes_that_are_lost_doubled_or_overwritten_are_never_taken_for_values(
    tmp_path: Path, whole: tuple[bytes, tuple[Recording, ...]]
) -> None:
    data, originals = whole
    chance = random.Random(7)

    for damaged in mutations(data, chance, count=500):
        assert holds_nothing_wrong(tmp_path / "a", damaged, originals)


def mutations(data: bytes, chance: random.Random, count: int) -> Iterator[bytes]:
    """Yield the data with a piece left out, doubled, moved or filled with noise."""
    for _ in range(count):
        a, b = sorted(chance.sample(range(len(data) + 1), 2))
        to = chance.randrange(len(data))
        noise = chance.randbytes(min(b - a, 16))
        yield chance.choice(
            [
                data[:a] + data[b:],
                data[:b] + data[a:],
                data[:a] + noise + data[a + len(noise) :],
                data[:to] + data[a:b] + data[to:],
                noise + data[a:],
            ]
        )


def test_a_cut_file_says_how_much_was_left_out(
    tmp_path: Path, whole: tuple[bytes, tuple[Recording, ...]]
) -> None:
    data, _ = whole
    # The longer the beginning, the more samples it gives, as the test above has it.
    lengths = range(len(data))
    end_of_second_chunk = bisect_left(lengths, 4, key=lambda n: _samples(tmp_path / "a", data[:n]))
    assert _samples(tmp_path / "a", data[:end_of_second_chunk]) == 4
    path = tmp_path / "a.mcap.part"
    path.write_bytes(data[: end_of_second_chunk + 5])

    (recording,) = read(path)

    assert recording.stopped.reason == "unknown"
    assert recording.findings[-1].sentence.endswith("the last 5 bytes of the file were left out")


def test_a_recording_that_was_never_ended_says_so(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "a.mcap") as writer:
        writer.begin(opening(), TOGETHER)
        writer.append(0, np.ones((2, 3)))

    (recording,) = read(tmp_path / "a.mcap")

    assert "never ended" in recording.findings[-1].sentence


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "isn't an MCAP file"),
        (b"time;voltage\n0;1\n", "isn't an MCAP file"),
        (mcap.MAGIC, "breaks off at its very beginning"),
        (mcap.MAGIC + mcap.header("servobench 1"), "nothing in it can be read"),
        (mcap.MAGIC + mcap.header("servobench 1") + mcap.data_end(0), "it holds no recording"),
    ],
)
def test_what_holds_no_recording_is_an_error_that_says_why(tmp_path: Path, data: bytes, said: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(data)

    with pytest.raises(FormatError, match=said):
        read(path)


def test_a_missing_file_and_a_folder_are_errors_of_ours(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.mcap", tmp_path, "a\0b", ""):
        with pytest.raises(FormatError, match="can't be read"):
            read(path)


def test_an_mcap_file_of_another_program_is_called_one(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with open(path, "wb") as file:
        writer = Writer(file)
        writer.start(library="rosbag2")
        channel = writer.register_channel("/joints", "json", 0)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()

    with pytest.raises(
        FormatError,
        match=r"is an MCAP file written by 'rosbag2.*only servobench's own files can be recovered",
    ):
        read(path)


def bomb(chunk: bytes) -> bytes:
    """Return a file whose description is right, and whose only chunk is this one."""
    group = Group(number=1, topic="/a/b", channels=("x",), timed=True)
    description = Opening(
        name="bomb",
        channels=(small()["counts"].channel,),
        groups=(replace(group, channels=("counts",)),),
        source=Source(name=""),
    )
    return mcap.MAGIC + mcap.header("servobench 1") + mcap.metadata(OPENING, entries(description)) + chunk


def chunk(packed: bytes, size: int) -> bytes:
    """Return a chunk record that claims to hold that many bytes."""
    head = struct.pack("<QQQI", 0, 0, size, zlib.crc32(b"\0" * min(size, 1 << 26)))
    return mcap.record(
        mcap.Op.CHUNK, head, mcap.prefix_length("zstd"), struct.pack("<Q", len(packed)), packed
    )


SIXTY_FOUR_MEGABYTES = 1 << 26


@pytest.mark.parametrize(
    "record",
    [
        chunk(zstandard.compress(b"\0" * SIXTY_FOUR_MEGABYTES), SIXTY_FOUR_MEGABYTES),  # both tell the truth
        chunk(zstandard.compress(b"\0" * SIXTY_FOUR_MEGABYTES), 100),  # the record lies
        chunk(zstandard.compress(b"\0" * 100), 1 << 60),  # the other way round
        struct.pack("<BQ", mcap.Op.CHUNK, 1 << 62),  # more than the file has
        struct.pack("<BQ", mcap.Op.METADATA, (1 << 64) - 1),
    ],
    ids=["large", "larger than it says", "smaller than it says", "past the end", "past all ends"],
)
def test_a_file_that_claims_much_gets_no_memory_for_it(tmp_path: Path, record: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(bomb(record))
    read(path)  # what is loaded the first time doesn't count

    tracemalloc.start()
    try:
        (recording,) = read(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()

    assert recording.findings[-1].code == "recording-cut-short"
    assert peak < 1 << 20


def test_a_description_in_a_million_pieces_is_read_in_linear_time(tmp_path: Path) -> None:
    # Copying the rest for each piece would move 10 MB a million times: hours, and pytest's time-out ends it.
    path = tmp_path / "a.mcap"
    pieces = mcap.record(
        mcap.Op.METADATA, mcap.prefix_length(OPENING), mcap.prefix_length(mcap.prefix_length("a") * 2_000_000)
    )
    path.write_bytes(mcap.MAGIC + mcap.header("servobench 1") + pieces)

    with pytest.raises(FormatError, match="nothing in it can be read"):
        read(path)


def test_a_description_that_contradicts_itself_is_damage_and_no_traceback(tmp_path: Path) -> None:
    channel = small()["counts"].channel
    group = Group(number=1, topic="/a/b", channels=("counts",), timed=True)
    good = Opening(name="r", channels=(channel,), groups=(group,), source=Source(name=""))
    bad = [
        replace(good, groups=()),
        replace(good, groups=(group, group)),
        replace(good, groups=(replace(group, channels=("other",)),)),
        replace(good, channels=(channel, channel), groups=(replace(group, channels=("counts", "counts")),)),
        replace(good, roles=replace(good.roles, input="other")),
    ]
    for description in bad:
        path = tmp_path / "a.mcap"
        path.write_bytes(
            mcap.MAGIC + mcap.header("servobench 1") + mcap.metadata(OPENING, entries(description))
        )
        with pytest.raises(FormatError, match="nothing in it can be read: a description"):
            read(path)


def test_metadata_that_another_program_added_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    save([small()], path)
    header = mcap.MAGIC + mcap.header("servobench 0.1.0")
    data = path.read_bytes()
    assert data.startswith(header)
    path.write_bytes(header + mcap.metadata("theirs", {"a": b"b"}) + data[len(header) :])

    assert read(path) == (small(),)

"""Row 19: a file that is damaged or cut gives a clean error or a beginning that is right; no wrong number, and little memory.

`tests/recordings/native/test_reader.py` holds the reader to the same with a file of two recordings, and with deceptive files.
Here it is the file that a run leaves, with its events, through the door that all commands use.
"""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import pytest

from servobench.core.errors import FormatError
from servobench.recordings.formats.base import load
from servobench.recordings.recording import Recording
from servobench.rig.loop.recording_process import record
from tests.files import refill
from tests.rig.loop.rings import RingLoop

TICKS = 12
MOST_MEMORY = 200e6  # bytes, for the largest of all readings


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Return the file of a run that ended, and the part that it was one look before."""
    path = tmp_path_factory.mktemp("run") / "a.mcap"
    parts: list[bytes] = []
    with RingLoop(
        path,
        ticks=TICKS,
        ticks_a_look=5,
        on_wait=lambda waits: parts.append(path.with_name("a.mcap.part").read_bytes()),
    ) as loop:
        loop.open()
        record(loop.spec, loop.rows, loop.events, loop)
    return {"whole": path.read_bytes(), "part": parts[-1]}


def loaded(path: Path, data: bytes) -> Recording:
    refill(path, data)
    (recording,) = load(path)
    return recording


def flipped(data: bytes, place: int, bits: int) -> bytes:
    return data[:place] + bytes([data[place] ^ bits]) + data[place + 1 :]


def is_right(path: Path, data: bytes, original: Recording) -> bool:
    """Whether those bytes give the recording, a beginning of it that says so, or an error that names the file."""
    refill(path, data)
    try:
        (found,) = load(path)
    except FormatError as error:
        return path.name in str(error)
    samples = len(found.series[0].values)
    beginning = tuple(
        replace(each, values=each.values[:samples], t=None if each.t is None else each.t[:samples])
        for each in original.series
    )
    if found.series != beginning or found.events != original.events[: len(found.events)]:
        return False
    same = replace(original, series=found.series, events=found.events, source=found.source)
    return found == same or (
        found.findings[-1].code == "recording-cut-short"
        and replace(found, findings=same.findings, stopped=same.stopped) == same
    )


@pytest.mark.promise("S26")
@pytest.mark.parametrize(("kind", "flip"), [("whole", 0x01), ("part", 0xFF)])
def test_each_byte_flipped_is_reported_or_costs_the_end(
    tmp_path: Path, files: dict[str, bytes], kind: str, flip: int
) -> None:
    data = files[kind]
    path = tmp_path / "a.mcap"
    original = loaded(path, data)

    assert [k for k in range(len(data)) if not is_right(path, flipped(data, k, flip), original)] == []


@pytest.mark.promise("S26")
def test_cut_at_each_length_it_is_a_beginning(tmp_path: Path, files: dict[str, bytes]) -> None:
    data = files["whole"]
    path = tmp_path / "a.mcap"
    original = loaded(path, data)

    assert [k for k in range(len(data)) if not is_right(path, data[:k], original)] == []


@pytest.mark.promise("S26")
def test_no_damage_takes_much_memory(tmp_path: Path, files: dict[str, bytes]) -> None:
    """To watch the memory makes reading slow, so it is each of the first bytes, and one in 23 of the rest."""
    data = files["whole"]
    path = tmp_path / "a.mcap"
    original = loaded(path, data)

    tracemalloc.start()
    try:
        for k in [*range(100), *range(100, len(data), 23)]:
            assert is_right(path, flipped(data, k, 0x7F), original)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()

    assert most < MOST_MEMORY

"""A recording whose file is read when a sample is looked at: nothing that happens to the file meanwhile goes unnoticed."""

import copy
import os
import sys
import weakref
from pathlib import Path

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.core.errors import StorageError
from servobench.core.finding import warning
from servobench.recordings.native import open_file
from servobench.recordings.native.open_file import MOST_OPEN, recording_in
from servobench.recordings.native.reader import read
from servobench.recordings.native.writer import RecordingWriter, Together, save
from servobench.recordings.recording import Recording, Series, Source, Stopped

OPENING = Recording(
    name="run",
    series=tuple(
        Series(channel=Channel(name=name, unit="V"), values=np.empty(0), t=np.empty(0)) for name in "ab"
    ),
    source=Source(name="twin"),
    input="a",
)
ENDED = Stopped(reason="finished", sentence="done")
FOUND = (warning("late-samples", "2 of 9 samples were late"),)
ROWS = np.arange(27.0).reshape(9, 3)

posix = pytest.mark.skipif(sys.platform == "win32", reason="an open file can't be moved or removed there")


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Return a file with the recording."""
    path = tmp_path / "a.mcap"
    with RecordingWriter(path) as writer:
        writer.begin(OPENING, [Together(channels=("a", "b"))])
        writer.append(0, ROWS)
        writer.end(ENDED, FOUND)
    return path


def unread(path: Path) -> Recording:
    return recording_in(path, OPENING, ENDED, FOUND)


def descriptors(path: Path) -> int:
    """Return how many files this process has open that are `path`."""
    folder = Path("/proc/self/fd")
    if not folder.is_dir():
        pytest.skip("this system doesn't list the files that a process has open")
    found = 0
    for name in os.listdir(folder):
        try:
            found += os.path.samestat(os.stat(folder / name), path.stat())
        except FileNotFoundError:  # the one of the list itself
            continue
    return found


def test_it_is_what_reading_the_file_gives(path: Path) -> None:
    recording = unread(path)

    assert (recording.findings, recording.stopped, recording.input) == (FOUND, ENDED, "a")
    assert recording == read(path)[0]
    assert recording["b"].values.tolist() == ROWS[:, 2].tolist()


@posix
@pytest.mark.parametrize("what", ["moved", "removed", "replaced"])
def test_what_happens_to_the_file_does_not_matter(path: Path, what: str) -> None:
    recording, whole = unread(path), read(path)[0]
    if what == "moved":
        path.rename(path.with_name("b.mcap"))
    elif what == "removed":
        path.unlink()
    else:
        save([OPENING], path)

    assert recording == whole


@posix
@pytest.mark.parametrize(
    ("damage", "why"),
    [(b"", "something else was written into it"), (None, "is damaged")],
    ids=["written into", "a bit"],
)
def test_another_content_of_the_same_file_is_refused(path: Path, damage: bytes | None, why: str) -> None:
    recording, state = unread(path), path.stat()
    if damage is None:
        content = bytearray(path.read_bytes())
        content[content.index(b"zstd") + 40] ^= 1
        path.write_bytes(content)
        os.utime(path, ns=(state.st_atime_ns, state.st_mtime_ns))
    else:
        path.write_bytes(damage)

    for _ in range(2):
        with pytest.raises(StorageError, match=why):
            recording["a"].values  # noqa: B018


def test_copies_are_of_the_samples(path: Path) -> None:
    recording = unread(path)
    copied = copy.deepcopy(recording)
    path.unlink()

    assert copied == recording
    assert type(copied["a"]) is Series  # as another process gets it, too


@posix
def test_a_file_is_closed_once_it_is_read_or_nobody_can_read_it(path: Path) -> None:
    read_one, forgotten = unread(path), unread(path)
    assert descriptors(path) == 2

    read_one["a"].t  # noqa: B018
    assert descriptors(path) == 1

    del forgotten
    assert descriptors(path) == 0


@posix
def test_many_do_not_take_all_files_that_a_process_may_have(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(open_file, "_OPEN", weakref.WeakSet())  # not those of other tests that ran before
    many = [unread(path) for _ in range(MOST_OPEN + 5)]

    assert descriptors(path) == MOST_OPEN
    assert many[0] == many[-1]
    assert descriptors(path) == MOST_OPEN - 1

"""Rings in shared memory: what was written comes out in order and whole, and what doesn't come out is counted."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba.core.errors import TypingError

from servobench.core.compiled import compiled
from servobench.core.errors import FormatError, StorageError, UsageError
from servobench.rig.loop import segment
from servobench.rig.loop.kernels import push_row, read_rows, set_word
from servobench.rig.loop.leftovers import sweep
from servobench.rig.loop.ring import FAULT, LOOP_STATE, ROWS_KEPT, MessageRing, RowReader, RowRing
from servobench.rig.loop.segment import HEAD, MAGIC, SLOTS, VERSION, WIDTH

ROOT = Path(__file__).resolve().parents[3]
SLOTS_OF_SMALL = 8
WAIT = 120  # seconds until a process that should have ended is given up


@pytest.fixture
def ring() -> Iterator[RowRing]:
    """Return a ring of 8 slots for rows of 2 numbers, of which 7 can be read."""
    with RowRing.create(2, SLOTS_OF_SMALL) as made:
        yield made


def fill(ring: RowRing, first: int, end: int) -> None:
    for n in range(first, end):
        ring.push([n, -n])


def numbers(reader: RowReader, most: int = 4096) -> list[float]:
    return [row[0] for row in reader.read(most).tolist()]


def in_python(text: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a script; what it leaves to the resource tracker is told on its standard error, which ends with the tracker."""
    command = [sys.executable, "-W", "error", "-c", text, *words]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=WAIT, check=False)


def test_rows_come_out_in_the_order_in_which_they_were_written(ring: RowRing) -> None:
    reader = ring.reader()
    fill(ring, 0, 5)

    assert reader.read(3).tolist() == [[0, 0], [1, -1], [2, -2]]
    assert reader.read().tolist() == [[3, -3], [4, -4]]
    assert reader.read().shape == (0, 2)
    assert (reader.next, reader.missed, ring.written) == (5, 0, 5)


def test_a_reader_that_keeps_up_gets_everything_however_often_the_ring_wraps(ring: RowRing) -> None:
    reader = ring.reader()
    found = []
    for first in range(0, 700, 7):
        fill(ring, first, first + 7)
        found += numbers(reader)

    assert found == list(range(700))
    assert reader.missed == 0


@pytest.mark.promise("S29")
def test_an_overtaken_reader_learns_exactly_what_it_missed(ring: RowRing) -> None:
    reader = ring.reader()
    fill(ring, 0, 3)
    assert numbers(reader) == [0, 1, 2]
    fill(ring, 3, 20)

    # Of 20 rows the last 7 are there: the eighth slot is the one that row 20 would be written into.
    assert numbers(reader) == list(range(13, 20))
    assert (reader.next, reader.missed) == (20, 10)


def test_two_readers_don_t_know_of_each_other(ring: RowRing) -> None:
    early = ring.reader()
    fill(ring, 0, 6)
    late = ring.reader(4)
    assert numbers(late) == [4, 5]
    fill(ring, 6, 10)

    assert (numbers(early), early.missed) == (list(range(3, 10)), 3)
    assert (numbers(late), late.missed) == ([6, 7, 8, 9], 0)


def test_a_reader_begins_at_the_oldest_row_unless_reported_otherwise(ring: RowRing) -> None:
    fill(ring, 0, 20)
    oldest, first, ahead = ring.reader(), ring.reader(0), ring.reader(21)

    assert (numbers(oldest), oldest.missed) == (list(range(13, 20)), 0)
    assert (numbers(first), first.missed) == (list(range(13, 20)), 13)
    assert (numbers(ahead), ahead.next) == ([], 21)
    fill(ring, 20, 22)
    assert (numbers(ahead), ahead.missed) == ([21], 0)


@given(
    slots=st.sampled_from([2, 4, 8]),
    steps=st.lists(
        st.one_of(
            st.tuples(st.just("push"), st.integers(1, 20)),
            st.tuples(st.just("read"), st.integers(1, 10)),
            st.tuples(st.just("start"), st.none() | st.integers(0, 30)),
        )
    ),
)
def test_any_order_of_pushing_and_reading_is_that_of_a_list(
    slots: int, steps: list[tuple[str, int | None]]
) -> None:
    """The model: all rows ever pushed, of which the last `slots` - 1 are there, and a place in them."""
    with RowRing.create(1, slots) as ring:
        pushed, place, missed = 0, 0, 0
        reader = ring.reader()
        for what, n in steps:
            oldest = max(0, pushed - slots + 1)
            if what == "push":
                for _ in range(n or 0):
                    ring.push([pushed])
                    pushed += 1
            elif what == "start":
                reader = ring.reader(n)
                place, missed = oldest if n is None else n, 0
            elif n is not None:
                start = max(place, oldest)
                expected = list(range(start, min(pushed, start + n)))
                missed += start - place
                place = start + len(expected)
                assert numbers(reader, n) == expected
            assert (reader.next, reader.missed, ring.written) == (place, missed, pushed)


@pytest.mark.promise("S29")
@pytest.mark.parametrize(
    ("meanwhile", "expected"),
    [(0, [1, 2, 3, 4, 5, 6, 7]), (1, [2, 3, 4, 5, 6, 7]), (4, [5, 6, 7]), (6, [7]), (7, []), (20, [])],
)
def test_what_was_overwritten_while_it_was_copied_is_thrown_away_and_counted(
    ring: RowRing, meanwhile: int, expected: list[int]
) -> None:
    """The copy lies over the head itself, and the last word of the last record moves it on by so many records."""
    memory = ring.memory
    for n in range(8):
        push_row(memory, np.array([n, 8 + meanwhile]))
    out = memory[HEAD - 13 : HEAD + 1].reshape(7, 2)

    number, begin, end = read_rows(memory, 0, out)

    assert memory[HEAD] == 8 + meanwhile
    assert out[begin:end, 0].tolist() == expected
    # After 8 + m records the oldest whole one is number m + 1; all up to there are missed, read or not.
    assert number == 1 + meanwhile


# Narrow rows: the writer laps the reader between two reads. Wide ones: it overtakes it within a read, because a copy of 63 of
# them is a quarter of a megabyte that the reader is the first to touch, which takes longer than to write over it.
@pytest.mark.promise("S29")
@pytest.mark.parametrize(("columns", "rows"), [(8, 2_000_000), (512, 500_000)])
def test_nothing_is_torn_or_lost_uncounted_while_another_process_writes_as_fast_as_it_can(
    columns: int, rows: int
) -> None:
    with RowRing.create(columns, 64) as ring:
        command = [sys.executable, "-m", "tests.rig.loop.writing", ring.name, str(rows)]
        writer = subprocess.Popen(command, cwd=ROOT)
        try:
            reader = ring.reader()
            received = torn = 0
            ring.set(LOOP_STATE, 1)
            while ring.written < 1000 and writer.poll() is None:  # so that it is overtaken at least once
                time.sleep(0.001)
            while (ring.get(LOOP_STATE) != 2 and writer.poll() is None) or reader.next < ring.written:
                found = reader.read()
                expected = np.arange(reader.next - len(found), reader.next, dtype=float)
                torn += int(np.sum(found != expected[:, None]))
                received += len(found)
            assert writer.wait(WAIT) == 0
        finally:
            writer.kill()
            writer.wait()

        assert torn == 0
        assert reader.missed >= 1000 - 63
        assert received + reader.missed == rows == ring.written
        assert received >= 63  # at least the last ones, which nobody overwrote


@compiled
def echo(memory: segment.Memory, other: segment.Memory, out: np.ndarray) -> int:  # type: ignore[type-arg]
    """Copy what is in one ring into another, as a compiled tick would; return how many rows."""
    number, begin, end = read_rows(memory, 0, out)
    for k in range(begin, end):
        push_row(other, out[k])
    set_word(other, ROWS_KEPT, number + end - begin)
    return end - begin


def test_compiled_code_reads_and_writes_without_python(ring: RowRing) -> None:
    with RowRing.create(2, 16) as other:
        fill(ring, 0, 5)

        assert echo(ring.memory, other.memory, np.empty((10, 2))) == 5
        assert numbers(other.reader()) == [0, 1, 2, 3, 4]
        assert other.get(ROWS_KEPT) == 5


def test_compiled_code_can_t_push_a_row_of_another_width(ring: RowRing) -> None:
    with pytest.raises(ValueError, match="not as wide"):
        push_row(ring.memory, np.zeros(3))
    with pytest.raises(ValueError, match="not as wide"):
        read_rows(ring.memory, 0, np.zeros((4, 3)))
    assert ring.written == 0


def test_compiled_code_can_t_push_what_isn_t_64_bits_wide_and_in_one_piece(ring: RowRing) -> None:
    for row in (np.zeros(2, np.float32), np.zeros(4)[::2]):
        with pytest.raises(TypingError, match="rows of float64 or int64 that lie in one piece"):
            push_row(ring.memory, row)


def test_rows_keep_every_bit(ring: RowRing) -> None:
    odd = [-0.0, float("nan"), float("inf"), 5e-324, 2.0**53 + 1, -1e308]
    reader = ring.reader()
    for value in odd:
        ring.push((value, 0.1))

    assert reader.read()[:, 0].tobytes() == np.array(odd).tobytes()


def test_words_are_seen_by_every_process_that_is_attached(ring: RowRing) -> None:
    assert [ring.get(word) for word in range(8)] == [0] * 8
    with RowRing.attach(ring.name) as other:
        other.set(ROWS_KEPT, 2**62)
        other.set(FAULT, -1)

    assert [ring.get(word) for word in range(8)] == [0, 0, 2**62, 0, 0, -1, 0, 0]
    assert ring.written == 0


def test_texts_come_out_as_they_were_written() -> None:
    with MessageRing.create(4, 16) as ring, MessageRing.attach(ring.name) as other:
        reader = other.reader()
        texts = ["", "τ = 0.13 s", "x" * 16, "\udcff\0"]
        found = []
        for text in texts:
            ring.push(text)
            found += reader.read()

        assert found == texts
        for n in range(9):
            ring.push(str(n))
        assert (reader.read(), reader.missed, reader.next) == (["6", "7", "8"], 6, 13)


def test_a_text_that_is_too_long_is_refused_with_both_sizes() -> None:
    with MessageRing.create(4, 13) as ring:  # rounded up to 16
        with pytest.raises(UsageError, match=r"17 bytes is too long .* takes 16"):
            ring.push("é" * 8 + "e")
        assert ring.written == 0


@pytest.mark.parametrize(
    ("columns", "slots", "said"),
    [(0, 8, "columns = 0"), (2, 6, "6 slots"), (2, 1, "1 slots"), (2, 0, "0 slots")],
)
def test_a_ring_that_can_t_be_is_refused(columns: int, slots: int, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        RowRing.create(columns, slots)


@pytest.mark.parametrize("row", [[1.0], [1.0, 2.0, 3.0], [1.0, None], ["a", "b"]])
def test_a_row_that_doesn_t_fit_is_refused_and_not_written(ring: RowRing, row: list[float]) -> None:
    with pytest.raises(UsageError, match="2 numbers"):
        ring.push(row)
    assert ring.written == 0


def test_other_mistakes_say_what_is_possible(ring: RowRing) -> None:
    with pytest.raises(UsageError, match="no word 16"):
        ring.get(16)
    with pytest.raises(UsageError, match="no word -1"):
        ring.set(-1, 0)
    with pytest.raises(UsageError, match="record -1"):
        ring.reader(-1)
    with pytest.raises(UsageError, match="0 records"):
        ring.reader().read(0)


def test_a_closed_ring_says_so_and_can_be_closed_again(ring: RowRing) -> None:
    reader = ring.reader()
    ring.close()
    ring.close()
    for use in (lambda: ring.push([1, 2]), lambda: ring.written, reader.read, lambda: ring.get(FAULT)):
        with pytest.raises(UsageError, match=f"ring {ring.name} is closed"):
            use()
    with pytest.raises(UsageError, match=f"there is no shared memory called '{ring.name}'"):
        RowRing.attach(ring.name)


def test_the_memory_lives_as_long_as_somebody_holds_it(ring: RowRing) -> None:
    memory = ring.memory
    ring.push([3.0, 4.0])
    ring.close()

    assert memory[-2 * SLOTS_OF_SMALL :].view(float)[:2].tolist() == [3.0, 4.0]


def test_who_is_attached_keeps_the_ring_when_its_owner_has_removed_it(ring: RowRing) -> None:
    with RowRing.attach(ring.name) as other:
        fill(ring, 0, 3)
        ring.close()

        assert numbers(other.reader()) == [0, 1, 2]


def test_a_name_that_isn_t_there_is_a_clear_error() -> None:
    with pytest.raises(UsageError, match="there is no shared memory called 'servobench-rows-0-none'"):
        RowRing.attach("servobench-rows-0-none")


def test_another_program_s_memory_is_a_clear_error() -> None:
    foreign = SharedMemory(create=True, size=100_000)
    try:
        with pytest.raises(FormatError, match=f"{foreign.name}' belongs to another program"):
            RowRing.attach(foreign.name)
    finally:
        foreign.close()
        foreign.unlink()


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (MAGIC, 0, "another program"),
        (VERSION, 7, "layout 7, .* uses layout 2"),
        (SLOTS, 2**20, "is damaged"),
        (SLOTS, 7, "is damaged"),
        (WIDTH, 0, "is damaged"),
    ],
)
def test_a_ring_that_isn_t_as_it_should_be_is_a_clear_error(
    ring: RowRing, place: int, value: int, said: str
) -> None:
    ring.memory[place] = value
    with pytest.raises(FormatError, match=said):
        RowRing.attach(ring.name)


def test_a_ring_of_the_other_kind_is_a_clear_error(ring: RowRing) -> None:
    with pytest.raises(FormatError, match="holds rows; expected texts"):
        MessageRing.attach(ring.name)


UNDER_A_LIMIT = """
import os, resource, sys
from servobench.core.errors import StorageError
from servobench.rig.loop.ring import RowRing
sys.dont_write_bytecode = True  # else modules imported below are kept cut off, for whoever comes next
resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 16, 1 << 16))  # bytes: less than the ring
try:
    RowRing.create(16, 65536)
except StorageError as error:
    print(os.getpid(), error)
"""


@pytest.mark.promise("S57")
@pytest.mark.skipif(sys.platform == "win32", reason="ulimit is POSIX's")
def test_a_limit_for_the_size_of_files_is_reported_and_leaves_no_memory_behind() -> None:
    # Before Python 3.13 it waited for a lock that it held itself; `in_python` waits a minute.
    ended = in_python(UNDER_A_LIMIT)

    number, _, said = ended.stdout.partition(" ")
    size, _, reason = said.partition(" ")
    assert int(size) > 65536 * 16 * 8  # the rows alone: slots, columns, bytes
    assert reason.startswith(
        "bytes of shared memory aren't available: File too large; allow larger files (ulimit -f)"
    )
    assert not list(Path("/dev/shm").glob(f"servobench-*-{number}-*"))


def test_too_little_shared_memory_is_reported_before_it_is_touched(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    class Usage:
        free = 1000

    monkeypatch.setattr(segment, "FOLDER", str(tmp_path))
    monkeypatch.setattr(segment.shutil, "disk_usage", lambda _path: Usage)
    with pytest.raises(StorageError, match="1000 are left"):
        RowRing.create(8)


ATTACH = """
import sys
from servobench.rig.loop.ring import RowRing
with RowRing.attach(sys.argv[1]) as ring:
    ring.push([1, 2])
"""


def test_a_process_that_attached_leaves_the_ring_to_its_owner_and_says_nothing(ring: RowRing) -> None:
    done = in_python(ATTACH, ring.name)

    assert (done.returncode, done.stderr) == (0, "")
    with RowRing.attach(ring.name) as other:
        assert other.reader().read().tolist() == [[1, 2]]


OWN = """
import multiprocessing
from servobench.rig.loop.ring import RowRing
from tests.rig.loop.test_ring import attach_and_push
with RowRing.create(2, 8) as ring:
    child = multiprocessing.get_context("spawn").Process(target=attach_and_push, args=(ring.name,))
    child.start()
    child.join()
    with RowRing.attach(ring.name) as other:
        assert other.reader().read().tolist() == [[5, 6]]
"""


def attach_and_push(name: str) -> None:
    """Write a row from a process that shares its parent's resource tracker."""
    with RowRing.attach(name) as ring:
        ring.push([5, 6])


def test_a_child_that_shares_the_resource_tracker_takes_nothing_from_its_parent() -> None:
    done = in_python(OWN)

    assert (done.returncode, done.stderr) == (0, "")


KILLED = """
import os
import signal
from servobench.rig.loop.ring import RowRing
ring = RowRing.create(2, 8)
print(ring.name, os.getpid(), flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.promise("S25")
@pytest.mark.skipif(sys.platform != "linux", reason="shared memory of Linux")
def test_what_a_killed_owner_left_is_removed_by_the_next_command_and_the_name_tells_whose_it_was() -> None:
    done = in_python(KILLED)
    name, process = done.stdout.split()

    assert name.startswith(f"servobench-rows-{process}-")
    assert done.stderr == ""
    path = Path("/dev/shm") / name
    os.utime(path, 2 * (time.time() + 3600,))
    sweep()
    assert path.exists()  # it is new: whoever makes it may not have locked it yet
    with RowRing.attach(name), RowRing.create(2, 8) as other:
        for each in (name, other.name):
            os.utime(Path("/dev/shm") / each, (0, 0))
        sweep()
        assert path.exists()  # somebody is attached, as a recorder whose command was killed
        assert (Path("/dev/shm") / other.name).exists()
    command = subprocess.run(
        [sys.executable, "-m", "servobench", "signals"], capture_output=True, timeout=WAIT, check=True
    )
    assert command.stderr == b""
    with pytest.raises(UsageError, match="there is no shared memory"):
        RowRing.attach(name)

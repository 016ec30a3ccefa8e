"""Foreign files are read in a child process: bombs, crashes and hangs end there, and the program says so."""

from __future__ import annotations

import os
import select
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats.base import FORMATS, read_here
from servobench.recordings.formats.base import load as load_here
from servobench.recordings.loading import reader_process
from servobench.recordings.loading.load import load
from servobench.recordings.loading.reader_process import Limits, ReaderProcess, the_reader
from tests.processes import children, most_memory
from tests.recordings.formats.makers import MAKERS, make

CHILD = "recordings.loading.child"
U = np.sign(np.sin(0.3 * np.arange(50)))
needs_linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells the memory of a process")


@pytest.fixture(autouse=True)
def new_child() -> Iterator[None]:
    """Let no child with other libraries read the files of the next test."""
    yield
    the_reader().close()


@pytest.fixture
def reader() -> Iterator[ReaderProcess]:
    with ReaderProcess() as made:
        yield made


@pytest.mark.parametrize(
    "name", ["mat", "parquet", "arrow", "tdms", "tdms foreign", "mat objects 7.3", "rosbag ros2"]
)
def test_what_the_child_reads_is_what_is_read_here(name: str, tmp_path: Path) -> None:
    if name in MAKERS:
        path = tmp_path / f"a{FORMATS[name.split()[0]].suffixes[0]}"
        MAKERS[name](path)
    else:
        path = make(name, tmp_path)

    assert load(path) == load_here(path)


@needs_linux
def test_one_child_reads_many_files_and_ends_with_the_program(tmp_path: Path) -> None:
    paths = [make("mat", tmp_path), make("tdms", tmp_path)]
    the_reader().close()

    for path in paths:
        load(path)
    (child,) = children(os.getpid(), CHILD)
    the_reader().close()

    assert not Path(f"/proc/{child}").exists()


@needs_linux
def test_the_child_ends_where_the_program_is_killed(tmp_path: Path) -> None:
    path = make("mat", tmp_path)
    program = (
        f"from servobench import load; load({str(path)!r}); print(flush=True); import time; time.sleep(600)"
    )
    started = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
    assert started.stdout is not None
    started.stdout.readline()
    (child,) = children(started.pid, CHILD)
    ended = os.pidfd_open(child)

    started.kill()
    started.communicate()

    assert select.select([ended], [], [], 60)[0]
    os.close(ended)


def test_text_is_read_without_a_child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ReaderProcess, "read", None)
    path = tmp_path / "a.csv"
    path.write_text("t,u\n0,1\n1,2\n")

    assert load(path)[0]["u"].values.tolist() == [1.0, 2.0]


def mat_of_zeros(path: Path, count: int) -> None:
    """A MAT file of version 5 with one compressed vector of zeros, written without ever holding or packing all of it."""
    scipy.io.savemat(path, {})
    zeros = bytes(2**20)
    size = 8 * count
    matrix = (
        struct.pack("<2I2I2I2i", 6, 8, 6, 0, 5, 8, count, 1)
        + struct.pack("<2I8s", 1, 1, b"u")
        + struct.pack("<2I", 9, size)
    )
    head = struct.pack("<2I", 14, len(matrix) + size) + matrix
    # After a full flush the same bytes are packed the same way again.
    packer = zlib.compressobj(1, wbits=-15)
    first, each, last = (
        packer.compress(part) + packer.flush(zlib.Z_FULL_FLUSH)
        for part in (head, zeros, zeros[: size % len(zeros)])
    )
    # Adler-32: a zero adds nothing to the lower sum, and the lower sum to the upper one.
    upper, lower = divmod(zlib.adler32(head), 2**16)
    sums = struct.pack(">2H", (upper + size * lower) % 65521, lower)
    packed = b"".join([b"\x78\x01", first, each * (size // len(zeros)), last, packer.flush(), sums])
    with path.open("ab") as file:
        file.write(struct.pack("<2I", 15, len(packed)) + packed)


def mat_7_of_zeros(path: Path, count: int) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        made = file.create_dataset("u", shape=(count,), dtype="f8", chunks=(10**6,), compression="gzip")
        made.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def table_of_zeros(path: Path, count: int) -> None:
    zeros = pa.table({"u": np.zeros(10**6)})
    with pq.ParquetWriter(path, zeros.schema, compression="zstd", use_dictionary=False) as writer:
        for _ in range(0, count, 10**6):
            writer.write_table(zeros)


def batches_of_zeros(path: Path, count: int) -> None:
    zeros = pa.table({"u": np.zeros(10**6)})
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_stream(str(path), zeros.schema, options=options) as writer:
        for _ in range(0, count, 10**6):
            writer.write_table(zeros)


BOMBS: dict[str, Callable[[Path, int], None]] = {
    "a.mat": mat_of_zeros,
    "b.mat": mat_7_of_zeros,
    "a.parquet": table_of_zeros,
    "a.arrows": batches_of_zeros,
}


@needs_linux
@pytest.mark.promise("S58")
@pytest.mark.parametrize("name", BOMBS)
@pytest.mark.parametrize("count", [40 * 10**6, 200 * 10**6])
def test_a_bomb_is_refused_and_the_program_does_not_grow(name: str, count: int, tmp_path: Path) -> None:
    """One that the child can hold, of 320 MB, and one that it can't, of 1.6 GB and its copies."""
    path = tmp_path / name
    BOMBS[name](path, count)
    (tmp_path / "small").mkdir()
    load(make(name.split(".")[1].replace("arrows", "arrow"), tmp_path / "small"))
    before = most_memory(os.getpid())

    with pytest.raises(FormatError, match=path.name):
        load(path)

    # What a line of the answer and the sentence take, and what the allocator keeps; the bomb is a hundred times that.
    assert most_memory(os.getpid()) < before + 3e6


@needs_linux
def test_a_file_of_constants_that_compress_well_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    mat_of_zeros(path, 5 * 10**6)
    assert path.stat().st_size < 300_000

    assert len(load(path)[0]["u"].values) == 5 * 10**6


def test_a_crash_of_the_library_is_an_error_and_the_next_file_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A child whose library kills it, in place of a file for which one does today and which the next version reads."""
    path = make("mat", tmp_path)
    (tmp_path / "scipy").mkdir()
    (tmp_path / "scipy" / "__init__.py").write_text(
        "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    the_reader().close()

    with pytest.raises(
        FormatError, match=rf"{path.name} can't be read: the library that reads it crashed \(SIGSEGV\)"
    ):
        load(path)
    monkeypatch.undo()

    assert load(path)


def test_an_error_that_nobody_expects_is_reported_with_its_last_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = make("tdms", tmp_path)
    (tmp_path / "nptdms.py").write_text("raise SystemExit('no licence')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    the_reader().close()

    with pytest.raises(FormatError, match=r"crashed \(no licence\)"):
        load(path)


@pytest.mark.parametrize("line", ["while True: pass", "import time; time.sleep(600)"])
def test_a_library_that_never_ends_is_ended(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = make("tdms", tmp_path)
    (tmp_path / "nptdms.py").write_text(f"{line}\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(reader_process, "_SECONDS", 3)
    the_reader().close()

    with pytest.raises(FormatError, match=r"a\.tdms can't be read: its library takes longer than 3 s"):
        load(path)


@needs_linux
def test_where_a_platform_has_no_limits_the_parent_watches(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader: ReaderProcess
) -> None:
    """A child without `resource`, and a limit of 300 MB so that it is over it as soon as it unpacks."""
    path = tmp_path / "a.mat"
    mat_of_zeros(path, 10**8)
    (tmp_path / "resource.py").write_text("raise ImportError\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(Limits, "of", lambda _: Limits(memory=3 * 10**8, seconds=60, content=10**8))

    with pytest.raises(FormatError, match="takes more than 300000000 bytes of memory"):
        reader.read("mat", path)


def test_what_isnt_installed_is_reported_by_the_child(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = make("tdms", tmp_path)
    (tmp_path / "nptdms.py").write_text("raise ImportError\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    the_reader().close()

    with pytest.raises(UsageError, match=r'a\.tdms: npTDMS.*pip install "servobench\[labview\]"'):
        load(path)


def test_an_interrupted_reading_leaves_no_answer_for_the_next_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reader: ReaderProcess
) -> None:
    first, second = make("mat", tmp_path), make("tdms", tmp_path)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(reader_process, "recordings_from_pipe", interrupt)
        with pytest.raises(KeyboardInterrupt):
            reader.read("mat", first)

    assert reader.read("tdms", second) == read_here("tdms", second)

"""A board that keeps the time, by the wall clock at a pseudo-terminal, with the device of docs/how-to/device.md as printed."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import board  # type: ignore[import-not-found]
import pytest

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")


@pytest.mark.promise("S52")
def test_the_board_s_first_samples_are_read_as_they_come(tmp_path: Path) -> None:
    (outcome,) = board.runs(1, 1.0, 200.0)

    # A loop that begins to read 1.2 s after the start answers each of the first ticks about as late. On a busy machine a
    # process may be held up for some tens of milliseconds: half of the ticks' voltages come within a tick of 5 ms all the same.
    assert outcome.status in (0, 3), (
        outcome.said
    )  # a second of a motor may be too little for a model, not for the loop
    assert outcome.late[0] < 0.005
    assert outcome.late[-1] < 0.6


def ran(folder: Path, port: str) -> subprocess.CompletedProcess[str]:
    """Run an experiment with the page's device at a port."""
    environment = board.installed(folder)
    (folder / "board.toml").write_text(board.EXPERIMENT.format(duration=1, rate=200, port=port))
    return subprocess.run(
        [sys.executable, "-m", "servobench", "run", "board.toml", "--out", "out"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


def check_reported(done: subprocess.CompletedProcess[str], port: str, *words: str) -> None:
    """Hold that it failed with one sentence or two, which say which port, what was expected and what to do."""
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 4, said
    assert "Traceback" not in said
    for word in (port, *words):
        assert word in said, said


@pytest.mark.promise("S53")
def test_a_port_that_is_not_there_is_reported(tmp_path: Path) -> None:
    check_reported(
        ran(tmp_path, "/dev/ttyNOTHERE"),
        "/dev/ttyNOTHERE",
        "can't be opened (No such file or directory)",
        "plug the board in",
    )


@pytest.mark.promise("S53")
@pytest.mark.parametrize(
    ("says", "words"),
    [
        (b"", ("nothing came from", "for 0.5 s", "look at its supply")),
        (
            b"hello world\n",
            ("expected 'tick microseconds counts since'", "b'hello world\\n'", "look at its firmware"),
        ),
    ],
    ids=["hung", "nonsense"],
)
def test_a_board_that_is_hung_or_talks_nonsense_is_reported(
    says: bytes, words: tuple[str, ...], tmp_path: Path
) -> None:
    with talking(says) as port:
        done = ran(tmp_path, port)

    check_reported(done, port, *words)


@contextmanager
def talking(says: bytes) -> Iterator[str]:
    """Be a board that answers `start` with some bytes and nothing more; gives its port."""
    master, slave = os.openpty()

    def answer() -> None:
        heard = b""
        with suppress(OSError):  # the port is closed
            while b"start" not in heard:
                heard += os.read(master, 100)
            os.write(master, says)

    threading.Thread(target=answer, daemon=True).start()
    try:
        yield os.ttyname(slave)
    finally:
        os.close(slave)
        os.close(master)

"""Somebody's board prints lines; `servobench watch` identifies its motor, and keeps what came whatever happens to it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import tty
from contextlib import suppress
from pathlib import Path

import pytest

import servobench as sb
from servobench.recordings.native.reader import read
from tests import forks

PATIENCE = 120.0  # s; in a fresh clone all kernels are compiled
ROWS = 5000


@pytest.fixture(scope="module")
def lines() -> list[str]:
    """A board's output for 10 s of a motor at 500 Hz: microseconds, volts and counts."""
    with sb.connect("twin") as motor:
        signal_ = sb.Square(low=-2, high=3, frequency=0.4)
        recording = sb.run(sb.Experiment(signal=signal_, duration=10, seed=1), motor)
    counts, u = recording["counts"], recording["applied"]
    assert counts.t is not None
    rows = zip(1e6 * counts.t, u.values, counts.values, strict=True)
    return ["rig 3 ready", "t_us,u,counts", *(f"{t:.0f},{v:.4f},{c:.0f}" for t, v, c in rows)]


def command(*words: object) -> list[str]:
    return [sys.executable, "-m", "servobench", "watch", *map(str, words), "--counts-per-rev", "2048"]


def test_lines_on_standard_input_end_in_a_report(lines: list[str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    ended = subprocess.run(
        command("-", "--out", out),
        input="\n".join(lines) + "\n",
        capture_output=True,
        text=True,
        check=False,
        timeout=PATIENCE,
    )

    assert ended.returncode == 0, ended.stderr
    assert "5000 rows in 10.0 s" in ended.stdout
    assert "gain ±" in ended.stdout
    assert sorted(each.name for each in out.iterdir()) == ["recording.mcap", "report.html", "result.json"]
    (recording,) = read(out / "recording.mcap")
    assert len(recording["counts"].values) == ROWS
    live = sb.identify(recording)
    assert json.loads((out / "result.json").read_text())["verdict"] == str(live.verdict)


def test_a_growing_file_ends_when_enough_is_known(lines: list[str], tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("\n".join(lines) + "\n")
    words = command(log, "--out", tmp_path / "out", "--until", "known", "--json")
    ended = forks.run(words[1:], cwd=tmp_path, timeout=int(PATIENCE))

    assert ended.returncode == 0, ended.stderr
    assert "stopped when enough was known" in ended.stderr
    assert "gain" in json.loads(ended.stdout)["parameters"]


def await_rows(folder: Path) -> None:
    """Wait until something of the stream is on the disk."""
    until = time.monotonic() + PATIENCE
    part = folder / "recording.mcap.part"
    while not (part.exists() and part.stat().st_size > 4_000):
        assert time.monotonic() < until, "nothing was recorded"
        time.sleep(0.05)


def watching(lines: list[str], out: Path) -> subprocess.Popen[str]:
    """A command that has recorded some of these lines, and waits for more."""
    process = subprocess.Popen(
        command("-", "--out", out), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    process.stdin.write("\n".join(lines) + "\n")
    process.stdin.flush()
    await_rows(out)
    return process


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_ends_it_with_a_result(lines: list[str], tmp_path: Path) -> None:
    process = watching(lines, tmp_path / "out")
    process.send_signal(signal.SIGINT)
    process.wait(PATIENCE)
    said, _ = process.communicate(timeout=PATIENCE)

    assert process.returncode == 0
    assert "interrupted; the motor" in said
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.skipif(os.name != "posix", reason="a process that is killed")
def test_what_came_outlives_a_kill(lines: list[str], tmp_path: Path) -> None:
    process = watching(lines, tmp_path / "out")
    process.kill()
    process.communicate(timeout=PATIENCE)

    (recording,) = read(tmp_path / "out" / "recording.mcap.part")
    assert (recording.input, recording.output) == ("u", "counts")
    assert sb.identify(recording).fit is not None


@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal as the serial port")
def test_a_serial_port_that_goes_on_sending_ends_after_the_time_asked_for(
    lines: list[str], tmp_path: Path
) -> None:
    """Lines from before the port was opened are dropped, as the first would be part of one."""
    board, port = os.openpty()
    tty.setraw(port)
    sender = threading.Thread(target=send, args=(board, "\n".join(lines[2:]) + "\n"), daemon=True)
    sender.start()
    words = [
        *command(os.ttyname(port), "--out", tmp_path / "out", "--stop-after", "8s"),
        *("--time", "column_1:us", "--input", "column_2:V", "--output", "column_3:counts"),
    ]
    ended = forks.run(words[1:], cwd=tmp_path, timeout=int(PATIENCE))
    os.close(port)
    os.close(board)

    assert ended.returncode == 0, ended.stderr
    assert "stopped at the time limit" in ended.stdout
    assert "gain ±" in ended.stdout
    assert (tmp_path / "out" / "report.html").exists()


def send(board: int, text: str) -> None:
    """Send until nobody listens any more."""
    data = text.encode()
    with suppress(OSError):
        while data:
            data = data[os.write(board, data[:500]) :]


@pytest.mark.skipif(os.name != "posix", reason="a pipe that breaks")
def test_a_reader_that_goes_away_costs_no_report(lines: list[str], tmp_path: Path) -> None:
    """As `| head` does: the stream is recorded to its end and reported, though nobody reads the words any more."""
    process = subprocess.Popen(
        command("-", "--out", tmp_path / "out"), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdout.close()
    process.stdin.write("\n".join(lines) + "\n")
    process.stdin.close()
    process.wait(PATIENCE)

    assert sorted(each.name for each in (tmp_path / "out").iterdir()) == [
        "recording.mcap",
        "report.html",
        "result.json",
    ]

"""Whatever signal asks a run to end in an orderly way puts out zero volts, whichever process it reaches."""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import servobench as sb

if sys.platform != "win32":
    from tests.hang.terminal import Bench, Terminal, bench, gone

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="terminals and signals of POSIX")

GONE = 30.0  # s; a process that has put out zero volts ends at once, on a machine however busy


@pytest.fixture
def hanging(tmp_path: Path) -> Iterator[Bench]:
    with bench(tmp_path) as found:
        yield found


def ends_at_zero_volts(hanging: Bench) -> bool:
    """Whether the last voltage that was taken is zero, and the device was stopped and closed after it."""
    words = [line.words for line in hanging.lines()]
    taken = [each for each in words if each[0] == "written"]
    return taken[-1] == ("written", "0.000000") and words[-1] == ("exit",) and ("stopped",) in words


@pytest.mark.promise("S45")
@pytest.mark.parametrize("key", ["c", "\\"])
def test_ctrl_backslash_puts_out_zero_volts_as_ctrl_c_does(hanging: Bench, key: str) -> None:
    hanging.begin()
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        terminal.await_words("running")
        terminal.press(key)
        status, _ = terminal.await_end()

    assert ends_at_zero_volts(hanging), (hanging.lines()[-12:], terminal.said)
    assert status == 130, terminal.said
    known = re.search(
        r"the motor is stopped \(zero volts from \d+\.\d\d s on\); saving and identifying the recording",
        terminal.said,
    )
    assert known, terminal.said
    assert known.start() < terminal.said.index("samples; ")
    assert "running" not in terminal.said[known.end() :]
    (recording,) = sb.load(hanging.out / "recording.mcap")
    assert recording.stopped.reason == "interrupted"
    assert ("SIGQUIT" in recording.stopped.sentence) == (key == "\\")


@pytest.mark.promise("S45")
@pytest.mark.parametrize("name", ["SIGQUIT", "SIGUSR1", "SIGXCPU"])
@pytest.mark.parametrize("to", ["the command", "the loop"])
def test_a_signal_to_one_process_of_a_run_puts_out_zero_volts(hanging: Bench, name: str, to: str) -> None:
    hanging.begin()
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        terminal.await_words("running")
        loop = hanging.loop
        os.kill(terminal.pid if to == "the command" else loop, signal.Signals[name])

        assert gone(loop, GONE)
    assert ends_at_zero_volts(hanging)

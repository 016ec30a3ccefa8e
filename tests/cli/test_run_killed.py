"""`servobench run` in real time, of which something is killed, stopped, or asked for twice: what the command then says."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import servobench as sb
from servobench.finding import Severity
from tests.cli.conftest import checked, started
from tests.cli.test_run import HOST, names

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


@pytest.fixture
def host(tmp_path: Path) -> Path:
    file = tmp_path / "host.toml"
    file.write_text(HOST)
    return file


def await_motion(child: subprocess.Popen[str]) -> None:
    """Wait for the line with the time left, the first word after the motor has begun to turn."""
    assert child.stderr is not None
    assert any(line.startswith("running, ") for line in child.stderr)


def loop_of(folder: Path) -> int:
    """The number of the loop's process, which stands in the recording's first event."""
    (recording,) = sb.load(folder / "recording.mcap.part")
    return int(json.loads(recording.events[0].text)["pid"])


@pytest.mark.promise("S22")
def test_a_loop_that_is_killed_is_a_failure_with_a_warning_that_says_what_to_do(
    host: Path, tmp_path: Path
) -> None:
    with started("run", host, "--out", tmp_path / "run", "--json") as child:
        await_motion(child)
        os.kill(loop_of(tmp_path / "run"), signal.SIGKILL)
        out, err = child.communicate(timeout=120)

    assert child.returncode == 4, err
    assert "Error: the loop's process ended without a word" in err
    (recording,) = sb.load(tmp_path / "run" / "recording.mcap")
    (found,) = (each for each in recording.findings if each.code == "loop-died")
    assert found.severity is Severity.WARNING
    assert "Switch off the supply, then look at the device's own watchdog" in found.sentence
    if out:  # as much as was recorded until then may be too little for a result
        assert checked(json.loads(out))["verdict"] != "trusted"

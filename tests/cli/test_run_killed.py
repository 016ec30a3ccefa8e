"""`servobench run` in real time, of which something is killed, stopped, or asked for twice: what the command then says."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

import servobench as sb
from servobench.core.finding import Severity
from servobench.rig.loop.child import RECORDER_PATIENCE
from tests.cli.conftest import checked, in_a_fork, started
from tests.cli.test_run import FILES, HOST, names

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


def children(parent: int, module: str) -> list[int]:
    """The processes that a process has started from a module of ours."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            if int(fields[1]) == parent and module in (folder / "cmdline").read_text():
                found.append(int(folder.name))
    return found


@pytest.mark.promise("S28")
def test_a_recording_that_is_being_written_is_taken_away_by_nobody(host: Path, tmp_path: Path) -> None:
    with started("run", host, "--out", tmp_path / "run") as child:
        await_motion(child)
        for words in (
            ("recover", tmp_path / "run"),
            ("run", "--out", tmp_path / "run"),
            ("inspect", tmp_path / "run"),
        ):
            ended = in_a_fork(*words)
            assert ended.status == 2, ended
            assert (
                "recording.mcap.part is being written by a running experiment: wait until it ends"
                in ended.err
            )
            assert "servobench recover" not in ended.err
        child.send_signal(signal.SIGTERM)
        _, err = child.communicate(timeout=120)

    assert child.returncode == 130, err
    assert names(tmp_path / "run") == FILES
    (recording,) = sb.load(tmp_path / "run" / "recording.mcap")
    assert "stopped by SIGTERM" in recording.stopped.sentence


@pytest.mark.promise("S17")
def test_ctrl_c_before_a_run_begins_leaves_no_folder_and_says_so(host: Path, tmp_path: Path) -> None:
    with started("run", host, "--out", tmp_path / "run") as child:
        while not (tmp_path / "run").exists() and child.poll() is None:
            pass
        child.send_signal(signal.SIGINT)
        _, err = child.communicate(timeout=120)

    assert child.returncode == 130, err
    assert "stopped from the keyboard before the run began; nothing was recorded" in err
    assert "Traceback" not in err
    assert "resource_tracker" not in err
    assert not (tmp_path / "run").exists()


@pytest.mark.long  # it waits for 15 s; tests/rig/loop/test_attendants.py has the same with a clock of its own
@pytest.mark.promise("S23")
def test_a_recorder_that_hangs_is_reported_and_costs_nothing(host: Path, tmp_path: Path) -> None:
    with started("run", host, "--out", tmp_path / "run") as child:
        await_motion(child)
        os.kill(children(child.pid, "recording_process")[0], signal.SIGSTOP)
        _, err = child.communicate(timeout=120)

    assert child.returncode == 5, err
    assert "no sign of the recorder for more than 5 s" in err
    assert "the motor is stopped; waiting for the recorder to finish the file (at most 10 s)" in err
    (recording,) = sb.load(tmp_path / "run" / "recording.mcap")
    assert "recorder-died" in {each.code for each in recording.findings}


@pytest.mark.promise("S56")
def test_a_recorder_that_dies_before_the_run_begins_is_reported_at_once_and_nothing_moves(
    host: Path, tmp_path: Path
) -> None:
    with started("run", host, "--out", tmp_path / "run") as child:
        while not (found := children(child.pid, "recording_process")) and child.poll() is None:
            pass
        os.kill(found[0], signal.SIGKILL)
        killed = time.monotonic()
        _, err = child.communicate(timeout=120)
        passed = time.monotonic() - killed

    assert child.returncode == 5, err
    assert "the recorder's process died (it was ended by signal 9); nothing was moved" in err
    assert "running" not in err
    assert not (tmp_path / "run").exists()
    # The loop, which is being loaded meanwhile, ends first: that takes as long as the machine takes. Without being told of it the
    # loop waits for as long as this once it's there.
    assert passed < RECORDER_PATIENCE


@pytest.mark.promise("S55")
@pytest.mark.parametrize("how", ["removed", "renamed"])
def test_a_folder_that_is_taken_away_in_a_run_costs_nothing_and_is_reported(
    host: Path, tmp_path: Path, how: str
) -> None:
    folder = tmp_path / "run"
    host.write_text(HOST.replace("300 s", "4 s"))
    with started("run", host, "--out", folder) as child:
        await_motion(child)
        if how == "removed":
            shutil.rmtree(folder)
        else:
            folder.rename(tmp_path / "other")
        _, err = child.communicate(timeout=120)

    saved = tmp_path / "run-recording.mcap"
    assert child.returncode == 5, err
    assert f"{folder / 'recording.mcap'} was removed or renamed while it was written" in err
    assert f"the recording is in {saved} (servobench identify {saved})" in err
    assert not folder.exists()
    (recording,) = sb.load(saved)
    assert recording.stopped.sentence == "ran for 4 s, as asked"
    ticks = np.rint(recording["scheduled"].values / 0.002)
    assert ticks.tolist() == list(range(2000))


@pytest.mark.promise("S25")
@pytest.mark.skipif(not Path("/dev/shm").is_dir(), reason="shared memory of Linux")
@pytest.mark.parametrize("killed", ["the command", "the command and the loop"])
def test_who_survives_clears_up_and_says_what_was_recorded(host: Path, tmp_path: Path, killed: str) -> None:
    def left() -> list[Path]:
        return list(Path("/dev/shm").glob(f"servobench-*-{child.pid}-*"))

    with started("run", host, "--out", tmp_path / "run") as child:
        await_motion(child)
        assert len(left()) == 3
        loop = loop_of(tmp_path / "run")
        child.kill()
        if killed == "the command and the loop":
            os.kill(loop, signal.SIGKILL)
        _, err = child.communicate(timeout=120)
        deadline = time.monotonic() + 60
        while (left() or not (tmp_path / "run" / "recording.mcap").exists()) and time.monotonic() < deadline:
            time.sleep(0.05)

    assert left() == []
    assert "resource_tracker" not in err
    (recording,) = sb.load(tmp_path / "run" / "recording.mcap")
    assert recording.stopped.reason == ("interrupted" if killed == "the command" else "error")


@pytest.mark.promise("S22")
def test_a_loop_that_is_killed_is_a_failure_with_a_warning_that_says_what_to_do(
    host: Path, tmp_path: Path
) -> None:
    with started("run", host, "--out", tmp_path / "run", "--json") as child:
        await_motion(child)
        os.kill(loop_of(tmp_path / "run"), signal.SIGKILL)
        out, err = child.communicate(timeout=120)

    assert child.returncode == 4, err
    assert "Error: the loop's process ended without a message" in err
    (recording,) = sb.load(tmp_path / "run" / "recording.mcap")
    (found,) = (each for each in recording.findings if each.code == "loop-died")
    assert found.severity is Severity.DANGER
    assert "Switch off the supply, then check the device's own watchdog" in found.sentence
    if out:  # as much as was recorded until then may be too little for a result
        assert checked(json.loads(out))["verdict"] != "trusted"

"""Messages that somebody must act on come first: on the terminal, in the result and in the report."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import servobench as sb
from tests.cli.conftest import checked

if sys.platform != "win32":
    from tests.hang.terminal import LONGEST, Bench, Terminal, bench

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="terminals and signals of POSIX")

URGENT = "SWITCH OFF THE SUPPLY"


@pytest.fixture
def hanging(tmp_path: Path) -> Iterator[Bench]:
    with bench(tmp_path) as found:
        yield found


@pytest.mark.promise("S46")
def test_a_stop_that_raised_is_said_before_anything_is_identified_and_ends_with_status_4(
    hanging: Bench,
) -> None:
    hanging.begin(call="stop", how="raises", duration="2 s")
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        terminal.await_words(URGENT)
        assert "samples; " not in terminal.said
        assert not (hanging.out / "result.json").exists()
        assert not (hanging.out / "data.csv").exists()
        status, _ = terminal.await_end()

    assert status == 4, terminal.said
    assert "a write of zero volts had returned before" in terminal.said
    # Again as the first line of the result, which begins with the number of samples.
    assert terminal.said.count(URGENT) == 2
    assert terminal.said.rindex(URGENT) < terminal.said.index("samples; ")
    result = checked(json.loads((hanging.out / "result.json").read_text(encoding="utf-8")))
    assert [each["code"] for each in result["findings"] if each["severity"] == "danger"] == ["stop-failed"]
    assert result["verdict"] != "trusted"
    page = (hanging.out / "report.html").read_text(encoding="utf-8")
    body = page[page.index("<body>") :]
    assert body.index(URGENT) < body.index('class="answer"')
    assert body.index(URGENT) < body.index(
        "<strong>Doubtful" if "<strong>Doubtful" in body else "<strong>Refused"
    )


@pytest.mark.promise("S46")
def test_a_loop_that_is_killed_is_reported_at_once_in_capitals(hanging: Bench) -> None:
    hanging.begin()
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        terminal.await_words("running")
        subprocess.run(["kill", "-KILL", str(hanging.loop)], check=True)
        terminal.await_words(
            "KILLED BY SIGKILL (KILLED); ZERO VOLTS WERE NOT CONFIRMED; SWITCH OFF THE SUPPLY"
        )
        assert "samples; " not in terminal.said
        status, _ = terminal.await_end()

    assert status == 4
    assert "running" not in terminal.said[terminal.said.index("SWITCH OFF THE SUPPLY") :]
    assert "the motor is stopped" not in terminal.said
    (recording,) = sb.load(hanging.out / "recording.mcap")
    assert [each.code for each in recording.findings if each.severity == "danger"] == ["loop-died"]


@pytest.mark.promise("S46")
def test_an_error_of_a_device_that_is_closed_is_reported_and_ends_with_status_4(hanging: Bench) -> None:
    hanging.begin(call="exit", how="raises", duration="1 s")
    ended = subprocess.run(
        [sys.executable, "-m", "servobench", "run", hanging.experiment, "--out", hanging.out],
        env=hanging.environment,
        capture_output=True,
        text=True,
        timeout=LONGEST,
    )

    assert ended.returncode == 4, ended.stderr
    assert re.search(
        r"^The device could not be closed \(OSError\('exit was refused'\)\)", ended.stderr, re.MULTILINE
    )
    assert "Traceback" not in ended.stderr
    (recording,) = sb.load(hanging.out / "recording.mcap")
    assert "close-failed" in {each.code for each in recording.findings}

"""A device call that hangs: what the terminal says, that the first Ctrl-C ends the command, and that no process is left."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import servobench as sb
from servobench.rig.loop.last_resort import _MARGIN
from servobench.rig.loop.silence import RUN_PATIENCE
from tests.cli.test_run_killed import children

if sys.platform != "win32":
    from tests.hang.terminal import Bench, Terminal, bench, gone

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="terminals and signals of POSIX")

# On a quiet machine the words come 0.8 s after the call began and the command ends 0.6 to 1 s after Ctrl-C (promised: 1 s, 2 s).
# With eight busy processes on two processors all but the sleeping takes four times as long; without an answer it was for ever.
WORDS = 3.0  # s
END = 8.0  # s
LAST_RESORT = RUN_PATIENCE + _MARGIN + 2.0  # s; its timer begins with the call, and is looked at after that

CONFIRMED = "ZERO VOLTS WERE CONFIRMED; SWITCH OFF THE SUPPLY"
UNKNOWN = "ZERO VOLTS WERE NOT CONFIRMED; SWITCH OFF THE SUPPLY"


@pytest.fixture
def hanging(tmp_path: Path) -> Iterator[Bench]:
    with bench(tmp_path) as found:
        yield found


@pytest.mark.promise("S42", "S43")
@pytest.mark.parametrize(
    ("call", "how", "known"),
    [
        ("read", "sleeps", CONFIRMED),
        (
            "read",
            "keeps the lock",
            UNKNOWN,
        ),  # nothing else in that process can run, so nobody can put out zero volts
        pytest.param("write", "sleeps", CONFIRMED, marks=pytest.mark.long),
        ("write", "blocks", CONFIRMED),
        pytest.param("write", "keeps the lock", UNKNOWN, marks=pytest.mark.long),
        ("start", "blocks", UNKNOWN),
        pytest.param("enter", "blocks", UNKNOWN, marks=pytest.mark.long),
        ("enter", "keeps the lock", UNKNOWN),
    ],
)
def test_a_call_that_hangs_is_reported_in_capitals_and_the_first_ctrl_c_ends_the_command(
    hanging: Bench, call: str, how: str, known: str
) -> None:
    hanging.begin(call=call, how=how)
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        hung = hanging.when("misbehaves")
        told = terminal.await_words(known)
        pressed = terminal.press("c")
        status, ended = terminal.await_end()

    assert "NO ANSWER FROM THE DEVICE FOR 0." in terminal.said
    assert told - hung < WORDS
    assert ended - pressed < END
    assert status == 4, terminal.said
    assert gone(hanging.loop, END)
    assert "Traceback" not in terminal.said
    if call in ("read", "write"):
        (recording,) = sb.load(hanging.out / "recording.mcap")
        assert recording.stopped.reason == ("interrupted" if how == "sleeps" else "device_lost")
        assert len(recording["counts"].values) > 20  # 0.5 s of 2 ms, on a machine however busy
    else:
        assert "SWITCH OFF THE SUPPLY IF THE MOTOR TURNS" in terminal.said
        assert not hanging.out.exists()


@pytest.mark.promise("S42", "S43")
@pytest.mark.parametrize("how", [pytest.param("blocks", marks=pytest.mark.long), "keeps the lock"])
def test_a_stop_that_hangs_after_ctrl_c_is_reported_and_ended_without_a_second_one(
    hanging: Bench, how: str
) -> None:
    hanging.begin(call="stop", how=how)
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        terminal.await_words("running")
        pressed = terminal.press("c")
        status, ended = terminal.await_end()

    assert ended - pressed < END
    assert status == 4, terminal.said
    # The guard writes zero volts before it stops the device, and that write returned.
    assert CONFIRMED in terminal.said
    assert "TO A STOP" in terminal.said
    assert gone(hanging.loop, END)
    (recording,) = sb.load(hanging.out / "recording.mcap")
    assert recording.stopped.reason == "device_lost"
    assert [each.code for each in recording.findings if each.severity == "danger"] == ["device-silent"]


@pytest.mark.promise("S43")
@pytest.mark.parametrize("call", [pytest.param("start", marks=pytest.mark.long), "read"])
def test_where_the_end_itself_wakes_the_device_the_last_word_says_what_is_known_of_the_motor(
    hanging: Bench, call: str
) -> None:
    hanging.begin(call=call, how="keeps the lock until a signal")
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        terminal.await_words(UNKNOWN)
        terminal.press("c")
        status, _ = terminal.await_end()

    assert status == 4, terminal.said
    assert hanging.lines()[-1].words == ("exit",)  # the loop came to its own end, with a stop
    last = terminal.said[terminal.said.rindex("Error: ") :]
    assert "no answer from the device for " in last
    assert "; zero volts were confirmed; " in last


@pytest.mark.promise("S43")
@pytest.mark.parametrize("request_to_end", ["SIGTERM", pytest.param("SIGHUP", marks=pytest.mark.long)])
def test_a_request_to_end_does_the_same_as_ctrl_c(hanging: Bench, request_to_end: str) -> None:
    hanging.begin(call="read", how="blocks")
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        terminal.await_words(CONFIRMED)
        sent = terminal.send(signal.Signals[request_to_end])
        status, ended = terminal.await_end()

    assert ended - sent < END
    assert status == 4
    assert gone(hanging.loop, END)


@pytest.mark.promise("S43")
def test_where_nobody_presses_anything_the_run_ends_by_itself(hanging: Bench) -> None:
    hanging.begin(call="write", how="blocks", duration="3 s")
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        hung = hanging.when("misbehaves")
        status, ended = terminal.await_end()

    assert status == 4
    assert ended - hung < RUN_PATIENCE + END
    assert "servobench recover" in terminal.said
    # What hangs has no pace: of 3 s no more than 3 s are left, and after the words nothing is told as running.
    assert all(int(left) <= 3 for left in re.findall(r"(\d+) s left", terminal.said))
    assert "running" not in terminal.said[terminal.said.index("SWITCH OFF") :]
    made_whole = subprocess.run(
        [sys.executable, "-m", "servobench", "recover", hanging.out],
        env=hanging.environment,
        capture_output=True,
        text=True,
    )
    assert made_whole.returncode == 0, made_whole.stderr
    assert (hanging.out / "data.csv").exists()


@pytest.mark.promise("S42")
def test_where_a_write_hangs_and_zero_volts_are_not_taken_either_the_device_is_told_to_stop(
    hanging: Bench,
) -> None:
    # The write of zero volts waits for the one that hangs.
    hanging.begin(call="write", how="blocks", one_at_a_time=True)
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        hung = hanging.when("misbehaves")
        terminal.await_words(CONFIRMED)
        stopped = hanging.when("stopped")
        terminal.press("c")
        assert terminal.await_end()[0] == 4

    # The watchdog waits for 0.3 s here, then 0.1 s for zero volts.
    assert stopped - hung < WORDS


@pytest.mark.promise("S44")
@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells the children of a process")
@pytest.mark.parametrize(
    ("call", "how"),
    [
        pytest.param("read", "blocks", marks=pytest.mark.long),
        pytest.param("read", "keeps the lock", marks=pytest.mark.long),
        ("enter", "blocks"),
        pytest.param("enter", "keeps the lock", marks=pytest.mark.long),
    ],
)
def test_no_process_survives_where_the_command_is_killed_while_the_loop_hangs(
    hanging: Bench, call: str, how: str
) -> None:
    hanging.begin(call=call, how=how)
    with Terminal(hanging, "run", hanging.experiment, "--out", hanging.out) as terminal:
        hanging.when("misbehaves")
        (recorder,) = children(terminal.pid, "recording_process")
        loop = hanging.loop
        os.kill(terminal.pid, signal.SIGKILL)

        assert gone(loop, LAST_RESORT)
        assert gone(recorder, LAST_RESORT)


@pytest.mark.promise("S42", "S43")
@pytest.mark.parametrize(
    ("call", "how", "known"),
    [
        ("read", "sleeps", CONFIRMED),  # nobody drives: the panel begins at zero volts
        ("enter", "keeps the lock", f"{UNKNOWN} IF THE MOTOR TURNS"),
    ],
)
def test_the_panel_says_the_same_words_and_the_first_ctrl_c_ends_it_with_status_4(
    hanging: Bench, call: str, how: str, known: str
) -> None:
    hanging.begin(call=call, how=how)
    words = ("panel", "--experiment", hanging.experiment, "--no-open", "--port", "0")
    with Terminal(hanging, *words, "--folder", hanging.folder / "recordings") as terminal:
        told = terminal.await_words("SWITCH OFF THE SUPPLY")
        hung = hanging.when("misbehaves")
        pressed = terminal.press("c")
        status, ended = terminal.await_end()

    assert told - hung < WORDS
    assert ended - pressed < END
    assert status == 4, terminal.said
    assert terminal.said.strip().endswith(known), terminal.said
    assert "at rest" not in terminal.said
    assert gone(hanging.loop, END)


@pytest.mark.promise("S43")
def test_the_panel_never_says_at_rest_of_a_motor_that_was_driven_and_took_no_zero_volts(
    hanging: Bench,
) -> None:
    pytest.importorskip("websockets", reason="the panel's extra is absent: websockets")
    from tests.panel.test_real_loop import Program

    hanging.begin(call="write", how="keeps the lock")  # what hangs is a write that drives
    folder = hanging.folder / "recordings"
    words = ("panel", "--experiment", hanging.experiment, "--no-open", "--port", "0", "--folder", folder)
    with Terminal(hanging, *words) as terminal:
        terminal.await_words("Ctrl-C")
        found = re.search(r"panel: ((http://\S+)/\?token=\S+)", terminal.said)
        assert found, terminal.said

        program = Program(Any, found[2], lambda: str(found[1]), folder)  # type: ignore[arg-type]  # its address is all that is needed

        async def driven() -> tuple[int, float]:
            sockets: list[Any] = []
            page = await program.page(sockets)
            hanging.when("written")  # its first zero volts
            assert (await page.say(do="lease"))["ok"]
            await page.say(do="start")
            await asyncio.to_thread(terminal.await_words, "SWITCH OFF THE SUPPLY")
            pressed = terminal.press("c")  # the page is still open
            status, ended = await asyncio.to_thread(terminal.await_end)
            await sockets[0].close()
            return status, ended - pressed

        status, lasted = asyncio.run(driven())

    assert lasted < END
    assert status == 4, terminal.said
    assert terminal.said.strip().endswith(UNKNOWN), terminal.said
    assert "at rest" not in terminal.said
    assert gone(hanging.loop, END)


@pytest.mark.promise("S43")
def test_the_panel_ends_with_status_4_where_the_device_raised_an_error_from_its_last_stop(
    hanging: Bench,
) -> None:
    hanging.begin(call="stop", how="raises")
    words = ("panel", "--experiment", hanging.experiment, "--no-open", "--port", "0")
    with Terminal(hanging, *words, "--folder", hanging.folder / "recordings") as terminal:
        hanging.when("written")
        terminal.press("c")
        status, _ = terminal.await_end()

    assert status == 4, terminal.said
    assert "at rest" not in terminal.said

"""The loop in its own process: what it hands on, what it is told, and that it ends with the motor at rest whatever happens."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import DeviceError, UsageError
from servobench.core.finding import danger, warning
from servobench.recordings.native.reader import read
from servobench.recordings.recording import Recording, Stopped
from servobench.rig.devices.base import error_text
from servobench.rig.devices.faults.base import table_of
from servobench.rig.devices.observed import Call
from servobench.rig.experiment import DeviceChoice, Experiment
from servobench.rig.experiment.limits import Limits, Watchdog
from servobench.rig.loop.exit_status import exit_text
from servobench.rig.loop.live import run_live
from servobench.rig.loop.messages import NOT_CLOSED, Command, Notice, Order, ending_to_json
from servobench.rig.loop.process import LoopProcess
from servobench.rig.loop.run import run
from servobench.rig.loop.silence import Silence
from servobench.rig.loop.spec import LoopSpec
from servobench.systems.control.pid import Pid
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.square import Square

TWIN = DeviceChoice(name="twin", settings={"timing": "host"})


def asked(duration: float | None = 0.5, **changes: object) -> Experiment:
    return Experiment(**{"duration": duration, "sample_time": 0.002, "device": TWIN, **changes})


def heard(loop: LoopProcess) -> list[Notice]:
    return [Notice.parse(text) for text in loop.events().read()]


@pytest.fixture(scope="module")
def commanded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Recording, list[Notice]]]:
    """A run that is told five things while it goes on, one of them nonsense."""
    path = tmp_path_factory.mktemp("run") / "a.mcap"
    with LoopProcess(asked(None), record=path) as loop:
        loop.command(Command(signal=Constant(value=2.0)))
        loop.command(Command(controller=Pid(kp=0.5, output="position")))
        loop.command(Command(enabled=False))
        loop._commands.push("no command")
        loop.command(Command(enabled=True, signal=Square(low=1, high=2, frequency=1)))
        while len(heard(loop)) < 6 and loop.ended is None:
            time.sleep(0.01)
        loop.stop("enough", "finished")
        recording = loop.wait()
        yield recording, heard(loop)


@pytest.mark.promise("S30")
def test_every_tick_is_recorded_or_counted_as_missed(tmp_path: Path) -> None:
    recording = run_live(asked(), to=tmp_path / "a.mcap")

    ticks = np.round(recording["scheduled"].values / 0.002).astype(int)
    said = " ".join(finding.sentence for finding in recording.findings)
    missed = 250 - len(ticks)
    assert (f"{missed} of 250 samples were missed" in said) == (missed > 0)
    assert np.all(np.diff(ticks) >= 1)
    t = recording["counts"].t
    assert t is not None
    assert np.all(np.diff(t) > 0)
    assert np.all(t - recording["scheduled"].values > -1e-9)  # the clock counts whole nanoseconds
    assert recording.stopped.reason == "finished"
    assert recording.stopped.sentence == "ran for 0.5 s, as asked"
    assert (recording,) == read(tmp_path / "a.mcap")
    assert [event.kind for event in recording.events] == ["opened", "ended"]
    t = recording["counts"].t
    assert t is not None
    assert recording.events[-1].tick == round(recording["scheduled"].values[-1] / 0.002)
    assert recording.events[-1].time == t[-1]


@pytest.mark.promise("S36")
def test_each_command_is_acknowledged_with_the_tick_at_which_it_took_effect(
    commanded: tuple[Recording, list[Notice]],
) -> None:
    recording, notices = commanded
    answers = [notice for notice in notices if notice.kind == "command"]
    accepted = [answer for answer in answers if answer.about["accepted"]]

    assert [answer.about["number"] for answer in accepted] == [1, 2, 3, 4, 5]
    ticks = np.round(recording["scheduled"].values / 0.002).astype(int)
    number = recording["command"].values
    for answer in accepted[:-1]:
        first = int(np.argmax(number >= answer.about["number"]))
        assert ticks[first] == answer.tick
    assert np.all(np.diff(number) >= 0)
    refused = [answer for answer in answers if not answer.about["accepted"]]
    assert [(r.about["number"], r.about["what"]) for r in refused] == [(None, "no command")]


@pytest.mark.promise("S36")
def test_what_a_command_changes_shows_from_its_tick_on(commanded: tuple[Recording, list[Notice]]) -> None:
    recording, _ = commanded
    number, word = recording["command"].values, recording["commanded"].values

    assert np.all(word[number == 1] == 2.0)
    assert np.all(word[number == 3] == 0.0)
    # The position controller takes over from 2 V without a bump, and goes on from 0 V once it's let through again.
    assert word[np.argmax(number == 2)] == pytest.approx(2.0, abs=1e-9)
    assert word[np.argmax(number == 4)] == pytest.approx(0.0, abs=1e-9)
    assert set(recording["reference"].values[number == 4]) <= {1.0, 2.0}


@pytest.mark.promise("S36")
def test_the_commands_stand_in_the_recording(commanded: tuple[Recording, list[Notice]]) -> None:
    recording, notices = commanded

    assert [event.kind for event in recording.events] == [notice.kind for notice in notices]
    assert [json.loads(event.text) for event in recording.events] == [
        json.loads(notice.to_text()) for notice in notices
    ]
    assert recording.stopped.reason == "finished"
    assert recording.stopped.sentence == "enough"


def test_a_device_that_can_not_be_opened_is_reported_as_it_would_be_here(tmp_path: Path) -> None:
    nowhere = DeviceChoice(name="twin", settings={"timing": "host", "solver_step": "-1 ms"})

    with (
        pytest.raises(UsageError, match=r"solver_step is -0.001 s; expected more than 0"),
        LoopProcess(asked(device=nowhere), record=tmp_path / "a.mcap"),
    ):
        pytest.fail("it was entered")
    assert list(tmp_path.iterdir()) == []


def test_a_word_from_who_watches_ends_the_run(tmp_path: Path) -> None:
    recording = run_live(asked(None), to=tmp_path / "a.mcap", watch=lambda progress: "seen enough")

    assert (recording.stopped.reason, recording.stopped.sentence) == ("interrupted", "seen enough")


def test_who_looks_at_the_data_may_end_the_run_as_asked(tmp_path: Path) -> None:
    def look(so_far: Recording) -> str | None:
        return "told enough" if len(so_far["counts"].values) > 20 else None

    recording = run_live(asked(None), to=tmp_path / "a.mcap", look=look)

    assert (recording.stopped.reason, recording.stopped.sentence) == ("finished", "told enough")


@pytest.mark.promise("S17")
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_sigterm_to_the_loop_stops_the_motor_and_keeps_the_recording(tmp_path: Path) -> None:
    with LoopProcess(asked(None), record=tmp_path / "a.mcap") as loop:
        _await_rows(loop, 20)
        os.kill(loop.pid, signal.SIGTERM)
        recording = loop.wait()

    assert recording.stopped.reason == "interrupted"
    assert len(recording["counts"].values) >= 20


@pytest.mark.promise("S22")
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_loop_that_is_killed_leaves_a_whole_file_that_says_so(tmp_path: Path) -> None:
    with LoopProcess(asked(None), record=tmp_path / "a.mcap") as loop:
        _await_rows(loop, 50)
        os.kill(loop.pid, signal.SIGKILL)
        recording = loop.wait()
        written = loop.ring.written

    assert recording.stopped.reason == "error"
    assert "ended without a message" in recording.stopped.sentence
    assert len(recording["counts"].values) == written


@pytest.mark.promise("S20")
def test_an_operator_who_is_not_there_any_more_ends_the_run(tmp_path: Path) -> None:
    with LoopProcess(asked(None), record=tmp_path / "a.mcap", operator_timeout=0.5) as loop:
        recording = loop.wait()

    assert recording.stopped.reason == "interrupted"
    assert "no sign of the operator for 0.5 s" in recording.stopped.sentence


PROGRAM = """
import sys, time
from servobench.rig.loop.process import LoopProcess
from tests.rig.loop.test_process import asked
with LoopProcess(asked(None), record=sys.argv[1]) as loop:
    print(loop.pid, flush=True)
    time.sleep(60)
"""


@pytest.mark.promise("S21")
@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_program_that_is_killed_ends_the_run_and_the_file_is_whole(tmp_path: Path) -> None:
    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, tmp_path / "a.mcap"], stdout=subprocess.PIPE, text=True
    )
    assert program.stdout is not None
    program.stdout.readline()
    program.kill()
    program.wait()
    program.stdout.close()

    deadline = time.monotonic() + 60
    while not (tmp_path / "a.mcap").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    (recording,) = read(tmp_path / "a.mcap")
    assert recording.stopped.reason == "interrupted"
    assert "the program that started the run has ended" in recording.stopped.sentence


@pytest.mark.promise("S36")
def test_a_command_that_says_nothing_useful_is_refused_with_the_reason() -> None:
    for text, reason in [
        ("{}", "its number is missing"),
        ('{"number": true}', "expected a whole number"),
        ('{"number": 1, "voltage": 3}', "voltage"),
        ('{"number": 1, "signal": {"type": "constant", "value": NaN}}', "NaN isn't a number"),
        ('{"number": 1, "signal": {"type": "constant", "value": 1e999}}', "value"),
        ("[" * 100_000, "no command"),
        ("no command", "it isn't JSON \\(at character 1\\); expected an object with `number`"),
        ("[1]", "it isn't an object; expected one with `number`"),
    ]:
        with pytest.raises(UsageError, match=reason):
            Order.parse(text)


def test_what_is_no_experiment_or_no_device_is_reported() -> None:
    with pytest.raises(UsageError, match="3 isn't an experiment; expected an Experiment"):
        LoopProcess(3)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=r"experiment is 3 \(int\); expected an Experiment"):
        run(3, 4)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="'twin' isn't a device; expected one"):
        run(asked(), "twin")  # type: ignore[arg-type]


def test_a_sample_time_that_the_watchdog_cannot_wait_for_is_refused_before_anything_is_started(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*words: object, **how: object) -> None:
        raise AssertionError("a process was started")

    monkeypatch.setattr("subprocess.Popen", refuse)
    for sample_time, advice in (
        (5.0, r"can't exceed 0\.5 s, so use a sample time of at most 0\.25 s in real time"),
        (0.2, r"raise it to 0\.4 s, or use a sample time of at most 0\.05 s"),
    ):
        loop = LoopProcess(asked(20.0, sample_time=sample_time))
        with pytest.raises(UsageError, match=advice):
            loop.__enter__()


def test_a_ctrl_c_that_comes_while_a_silence_is_reported_ends_as_one_after_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[str] = []

    def press_ctrl_c(sentence: str) -> None:
        told.append(sentence)
        raise KeyboardInterrupt

    silence = Silence(call=Call.START, duration=1.0, expected=0.0, zero_volts=False)
    # It is silent until it is told to end, and wakes then.
    monkeypatch.setattr(
        "servobench.rig.loop.process.silence_of", lambda ring, sample_time: None if told else silence
    )
    with pytest.raises(
        DeviceError, match=r"while it is being started; .*stopped from the keyboard before it began"
    ):
        LoopProcess(asked(), alarm=press_ctrl_c).__enter__()
    assert told == [silence.warning]


def test_the_supply_comes_before_what_can_wait() -> None:
    told: list[str] = []
    loop = LoopProcess(asked(), alarm=told.append)
    waits = warning(NOT_CLOSED, "The device could not be closed.")
    urgent = danger("stop-failed", "SWITCH OFF THE SUPPLY.")
    stopped = Stopped(reason="finished", sentence="ran")
    loop._ended = Notice(kind="ended", about=ending_to_json(stopped, (waits, urgent)))
    loop._warn_of_danger()
    assert told == ["SWITCH OFF THE SUPPLY.", "The device could not be closed."]


def test_how_a_process_or_a_call_ended_is_reported_in_words() -> None:
    assert exit_text(3) == "with status 3"
    assert exit_text(-signal.SIGABRT) == "killed by SIGABRT (aborted)"
    request = KeyboardInterrupt("SIGTERM, which was sent to the loop's process")
    assert error_text(request) == "the call was interrupted by SIGTERM, which was sent to the loop's process"
    assert error_text(KeyboardInterrupt()) == "the call was interrupted by Ctrl-C"
    assert error_text(OSError("no")) == "OSError('no')"


def test_two_runs_into_one_file_the_second_says_why_it_could_not_begin(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.part").write_bytes(b"")
    with pytest.raises(UsageError, match=r"a\.mcap\.part exists already.*; nothing was moved"):
        run_live(asked(), to=tmp_path / "a.mcap")


def test_a_command_and_a_spec_come_through_as_they_were() -> None:
    command = Command(signal=Square(low=1, high=2, frequency=3), controller=Pid(kp=2.0, output="speed"))
    spec = LoopSpec(experiment=asked().to_toml(), rows="a", commands="b", events="c", recorded=True)

    assert Order.parse(command.to_text(7)) == Order(number=7, command=command)
    assert LoopSpec.from_line(spec.to_line()) == spec


def _await_rows(loop: LoopProcess, rows: int) -> None:
    deadline = time.monotonic() + 60
    while loop.ring.written < rows:
        if loop.ended is not None or time.monotonic() > deadline:
            raise DeviceError(f"the loop wrote {loop.ring.written} rows; {loop.ended}")
        time.sleep(0.01)


def held_up(**rules: Any) -> tuple[list[str], bool]:
    """The codes of the faults of a loop whose device holds it up for 80 ticks twice, and whether it goes on after that."""
    held = table_of("slow_read every=400 takes=80ms")
    experiment = Experiment(
        sample_time=0.001,
        duration=None,
        device=DeviceChoice(name="twin", settings={"timing": "host"}, faults=(held,)),
        limits=Limits(watchdog=Watchdog(timeout=0.5)),
    )
    with LoopProcess(experiment, when_faulted="hold", **rules) as loop:
        reader = loop.rows(0)
        t = [-1.0]
        while t[-1] < 1.0 and loop.ended is None:
            t += reader.read()[:, 0].tolist()
            time.sleep(0.02)
        events = [Notice.parse(text) for text in loop.events().read()]
        return [event.about["code"] for event in events if event.kind == "fault"], loop.ended is None


@pytest.mark.promise("S32")
def test_a_loop_that_holds_faults_goes_on_at_zero_volts_after_too_many_missed_ticks() -> None:
    assert held_up() == (["ticks-missed"], True)


def test_where_it_is_asked_for_missed_ticks_stop_nothing() -> None:
    assert held_up(missed_go_on=True) == ([], True)


@pytest.mark.skipif(os.name == "nt", reason="Windows sends Ctrl-C to a group of processes, never to one")
def test_ctrl_c_while_the_loops_process_still_imports_is_no_traceback_of_its_own(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    start = subprocess.Popen

    def interrupted(command: list[str], **options: Any) -> subprocess.Popen[bytes]:
        process = start(command, **options)
        if not options.get("start_new_session"):  # a terminal's Ctrl-C doesn't reach another session
            process.send_signal(signal.SIGINT)
        return process

    monkeypatch.setattr("servobench.rig.loop.process.subprocess.Popen", interrupted)
    with LoopProcess(asked(), record=tmp_path / "a.mcap") as loop:
        stopped = loop.wait().stopped
    assert stopped is not None
    assert stopped.reason == "finished"
    assert "Traceback" not in capfd.readouterr().err

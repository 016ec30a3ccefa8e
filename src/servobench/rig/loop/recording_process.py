"""The recorder, a process of its own: it reads the loop's rings and writes the native file; `python -m` this module.

It gets one line of JSON on standard input (`RecorderSpec`), and reports the outcome in one line of JSON on standard output. It
loads everything before it reads that line, so a process started in advance begins at once. The end of its input means that the
program is gone. It publishes its state, a heartbeat and the number of rows on disk in the ring of rows, so the loop learns
first if nothing can be written.
"""

from __future__ import annotations

import json
import logging
import math
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from tempfile import TemporaryFile
from threading import Thread
from types import FrameType, TracebackType
from typing import IO, Any, Protocol, Self, cast

from servobench.core.errors import ServobenchError, UsageError
from servobench.core.finding import Finding, warning
from servobench.recordings.recording import Stopped
from servobench.rig.experiment import Experiment, read_experiment
from servobench.rig.loop.drain import SILENT, Drain, loop_died
from servobench.rig.loop.messages import info_from_json
from servobench.rig.loop.opening import opening
from servobench.rig.loop.ring import (
    LOOP_STATE,
    RECORDER_HEARTBEAT,
    RECORDER_STATE,
    ROWS_KEPT,
    MessageRing,
    RowRing,
)
from servobench.rig.loop.ring import load as load_rings
from servobench.rig.loop.spec import DONE, ENDED, FAILED, RECORDING

INTERVAL = 0.03  # s between two looks at the rings; what is written on top of it stays below 50 ms
LAST_WORDS = 40  # looks to wait for the loop's last message, once an end is requested
STOPPING = 40  # looks for which a file that failed is kept open while the loop stops its motor

PATIENCE = 10.0  # s; how long a recorder may take to finish its file before it is killed, and the file completed from memory
SLOW = 1.0  # s; after that the waiting program gets a message

TOO_EARLY = Stopped(
    reason="error",
    sentence="the recorder was asked to end before the run did; the rest was not recorded",
)
ENDED_EARLY = warning(
    "recorder-ended-early",
    "The recorder was asked to end before the run did, and the rest is missing. Find out what ended its process.",
)


@dataclass(frozen=True, kw_only=True)
class Late:
    """The state that a recorder needs to begin in the middle of a run.

    The numbers of the first row and the first event that it records, the device as JSON can hold it (`info`), and the duration
    that it records [s], None until the word `RECORD_UNTIL` or the run's end says so.
    """

    row: int
    event: int
    info: Any
    duration: float | None = None


@dataclass(frozen=True, kw_only=True)
class RecorderSpec:
    """A recorder's task: the names of the rings of rows and events, its file's path, the experiment as TOML.

    `loop` is the number of the loop's process, None where it isn't known. `late` is None for one that records a run from its
    first row to its end. The ring of commands is no matter of the recorder's, but where everybody else is dead it clears up
    that one, too.
    """

    rows: str
    events: str
    path: str
    experiment: str
    loop: int | None = None
    late: Late | None = None
    commands: str = ""

    def line(self) -> str:
        """Return it as one line of JSON."""
        return json.dumps(asdict(self)) + "\n"

    @classmethod
    def from_line(cls, line: bytes) -> Self:
        """Return the spec in a line of ours."""
        fields = json.loads(line)
        late = fields.pop("late")
        return cls(late=None if late is None else Late(**late), **fields)


@dataclass(frozen=True, kw_only=True)
class RecorderResult:
    """The recorder's outcome: the `path` of the whole file, None if there is none; its number of rows; the `error`, if any."""

    path: str | None
    rows: int
    error: str = ""


class Signs(Protocol):
    """The recorder's surroundings beside the rings."""

    def wait(self) -> None:
        """Let `INTERVAL` pass."""
        ...

    def loop_gone(self) -> bool:
        """Return whether the loop's process is known to have ended."""
        ...

    def alone(self) -> bool:
        """Return whether the recorder has lost both the loop and the program."""
        ...

    def end_wanted(self) -> bool:
        """Return whether the recorder was asked to end."""
        ...


def record(spec: RecorderSpec, rows: RowRing, events: MessageRing, signs: Signs) -> RecorderResult:
    """Record a run from its rings to its end, whatever end that is, and return how it went.

    Raises `ServobenchError` (`StorageError` above all) where nothing can be recorded any more: the loop was told before, by the
    word `RECORDER_STATE`, and had time to stop its motor, and the part is closed as it is.
    """
    drain: Drain | None = None
    try:
        experiment = read_experiment(spec.experiment, spec.path)
        drain = _drain(spec, experiment, rows, events)
        # Silence is no news yet while the next row is still to come.
        patience = max(LAST_WORDS, math.ceil(3 * experiment.sample_time / INTERVAL))
        stopped = _follow(drain, rows, signs, patience)
        drain.take()  # what came since the last look, where no last word ends the run
        _publish(drain, rows)
        findings = (loop_died(rows),) if stopped is SILENT else (ENDED_EARLY,)
        is_there = drain.end(*(_early_end(spec, drain) or drain.ended or (stopped, findings)))
    except BaseException:
        rows.set(RECORDER_STATE, FAILED)
        _wait_for_rest(rows, signs)
        if drain is not None:
            drain.abandon()
        raise
    rows.set(RECORDER_STATE, DONE)
    return RecorderResult(path=spec.path if is_there else None, rows=drain.rows)


def _drain(spec: RecorderSpec, experiment: Experiment, rows: RowRing, events: MessageRing) -> Drain:
    """The sink for rows and events."""
    if spec.late is None:
        return Drain(spec.path, experiment, rows, events)
    info = info_from_json(spec.late.info)
    begun = opening(experiment, info, commanded_live=True, timing=info.timing)
    before = rows.reader(max(0, spec.late.row - 1)).read(1)
    if spec.late.row and len(before):
        column = 1 + [each.channel.name for each in begun.series].index("applied")
        begun = replace(begun, input_before=float(before[0, column]))
    return Drain(
        spec.path,
        experiment,
        rows,
        events,
        begun=begun,
        row=spec.late.row,
        event=spec.late.event,
        duration=spec.late.duration,
    )


def _early_end(spec: RecorderSpec, drain: Drain) -> tuple[Stopped, tuple[Finding, ...]] | None:
    """The reason why a recording ended before its run did; None if it didn't."""
    if not drain.complete or spec.late is None:
        return None
    how_long = "" if spec.late.duration is None else f" for {spec.late.duration:g} s at most"
    return Stopped(reason="finished", sentence=f"recorded{how_long}, as asked; the run went on"), ()


def _follow(drain: Drain, rows: RowRing, signs: Signs, patience: int) -> Stopped:
    """Write what comes until the loop says how it ended, or will never say it; return what to say then in its place.

    `patience` is for how many looks its last word is waited for: after it ended, after the recorder was asked to end, and where
    nothing comes and nobody is left to say anything. Where the loop is gone, whoever started it says the last word, if they are
    still there.
    """
    looks = patience
    while looks and drain.ended is None and not drain.complete:
        # Checked before the rings: a loop that has ended by now pushed its last message before.
        gone, over = signs.loop_gone(), rows.get(LOOP_STATE) == ENDED
        before = drain.taken
        drain.take()
        _publish(drain, rows)
        alone = signs.alone()
        if drain.ended is not None or drain.complete or (gone and alone):
            break
        if gone or over or signs.end_wanted() or (alone and drain.taken == before):
            looks -= 1
        else:
            looks = patience
        signs.wait()
    return TOO_EARLY if not looks and drain.taken > before else SILENT


def _publish(drain: Drain, rows: RowRing) -> None:
    """Publish the number of rows on disk and a heartbeat for the loop."""
    if drain.begun:
        rows.set(ROWS_KEPT, drain.kept)
        rows.set(RECORDER_STATE, RECORDING)
    rows.set(RECORDER_HEARTBEAT, time.monotonic_ns())


def _wait_for_rest(rows: RowRing, signs: Signs) -> None:
    """Wait until the loop has stopped its motor, or won't: to close a file on a disk that fails may take any time."""
    for _ in range(STOPPING):
        if rows.get(LOOP_STATE) == ENDED or signs.loop_gone():
            return
        signs.wait()


class _Process:
    """The signs that a process has: SIGTERM, the end of its standard input, and the end of the loop's process."""

    def __init__(self, loop: int | None) -> None:
        self._wanted = self._alone = False
        self.loop_gone = _end_of(loop)
        # Ctrl-C goes to all processes of a terminal; the loop answers it, and says so at its end.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, self._on_request)
        # A daemon, as it waits without end while the input stays open.
        Thread(target=self._listen, name="end of input", daemon=True).start()

    def wait(self) -> None:
        """Let the interval pass."""
        time.sleep(INTERVAL)

    def alone(self) -> bool:
        """Return whether the input has ended."""
        return self._alone

    def end_wanted(self) -> bool:
        """Return whether SIGTERM came."""
        return self._wanted

    def _on_request(self, number: int, frame: FrameType | None) -> None:
        self._wanted = True

    def _listen(self) -> None:
        os.read(sys.stdin.fileno(), 1)
        self._alone = True


def _end_of(process: int | None) -> Callable[[], bool]:
    """Return a function that tells whether a process has ended; where that can't be known, it never has.

    A handle stands for one process, even where its parent hasn't buried it yet; its number alone wouldn't.
    """
    if process is None or sys.platform != "linux":
        return lambda: False
    try:
        handle = os.pidfd_open(process)
    except ProcessLookupError:
        return lambda: True
    except OSError:  # an old kernel, or a sandbox
        return lambda: False
    return lambda: bool(select.select([handle], [], [], 0)[0])


def _first_line() -> bytes:
    """The first line of standard input, read without a buffer: at the process's end a thread still waits for the rest."""
    line = b""
    while not line.endswith(b"\n") and (more := os.read(sys.stdin.fileno(), 1 << 16)):
        line += more
    return line


def main() -> int:
    """Record as the line on standard input says; say in one line how it went, and return the exit status."""
    logging.disable(logging.WARNING)  # the program that started this one gives the same ones
    _load()
    line = _first_line()
    if not line:  # nothing was to be recorded
        return 0
    spec = RecorderSpec.from_line(line)
    signs = _Process(spec.loop)
    status = 0
    try:
        with RowRing.attach(spec.rows) as rows, MessageRing.attach(spec.events) as events:
            try:
                went = record(spec, rows, events, signs)
            finally:
                _clear_up(rows, events, spec.commands)
    except ServobenchError as error:
        status = error.exit_status
        went = RecorderResult(path=None, rows=0, error=str(error))
    sys.stdout.write(json.dumps(asdict(went)) + "\n")
    sys.stdout.flush()
    return status


def _load() -> None:
    """Load and compile what a recording needs, which takes longer than to begin one."""
    load_rings()
    read_experiment(Experiment().to_toml(), "the usual experiment")


def _clear_up(rows: RowRing, events: MessageRing, commands: str) -> None:
    """Remove the memory of a run if no other process is left to do so."""
    rows.clear_up()
    events.clear_up()
    with suppress(UsageError), MessageRing.attach(commands) as ring:  # the loop may have removed it
        ring.clear_up()


class RecorderProcess:
    """A recorder that runs beside this process; leaving its context lets it finish, and kills it where it doesn't.

    Without a `spec` it gets ready and waits for `begin`, after which it begins within milliseconds; `dismiss` ends one that
    wasn't needed. It is in a session of its own: what a terminal sends to its processes reaches the loop, which then says how
    it ended.
    """

    def __init__(self, spec: RecorderSpec | None = None) -> None:
        self._went: RecorderResult | None = None
        self._errors = TemporaryFile()  # noqa: SIM115 - closed in `wait`
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "servobench.rig.loop.recording_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,
        )
        if spec is not None:
            self.begin(spec)

    def begin(self, spec: RecorderSpec) -> None:
        """Let it record, once; where it is dead already `wait` tells."""
        with suppress(BrokenPipeError):
            _input(self._process).write(spec.line().encode())
            _input(self._process).flush()

    def dismiss(self) -> None:
        """End a recorder that was never started: it has nothing to lose."""
        self._process.kill()
        self._process.communicate()
        self._errors.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.wait()

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    @property
    def status(self) -> int | None:
        """The exit status of the process; None while it is still there."""
        return self._process.poll()

    @property
    def running(self) -> bool:
        """Whether the process is still there."""
        return self._process.poll() is None

    @property
    def failed(self) -> bool:
        """Whether the process ended other than with a whole file; `wait` gives the reason."""
        return self._process.poll() not in (None, 0)

    def wait(self, timeout: float = PATIENCE, slow: Callable[[], None] | None = None) -> RecorderResult:
        """Tell the recorder that nothing more is to come but the loop's end, wait for it, and return how it went.

        `slow` is called once where that takes longer than a second. After `timeout` [s] without an end it is killed. Where it
        failed or died, `error` says so and `complete` can help.
        """
        if self._went is None:
            try:
                output, _ = self._communicate(timeout, slow)
                reason = ""
            except subprocess.TimeoutExpired:
                self._process.kill()
                output, _ = self._process.communicate()
                reason = f"it didn't end within {timeout:g} s"
            self._went = _went(output, self._process.returncode, reason or _last_line(self._errors))
            self._errors.close()
        return self._went

    def _communicate(self, timeout: float, slow: Callable[[], None] | None) -> tuple[bytes, bytes]:
        """The output of the process up to its end; raises `TimeoutExpired`, after which it may be called again."""
        begin = min(SLOW, timeout)
        try:
            return self._process.communicate(timeout=begin)
        except subprocess.TimeoutExpired:
            if slow is not None:
                slow()
            return self._process.communicate(timeout=timeout - begin)


def _input(process: subprocess.Popen[bytes]) -> IO[bytes]:
    """The standard input of a process that was started with one."""
    return cast("IO[bytes]", process.stdin)


def _went(output: bytes, status: int, reason: str) -> RecorderResult:
    """The recorder's outcome, from its own report or else from the end of its process."""
    try:
        return RecorderResult(**json.loads(output))
    except (ValueError, TypeError):  # it had no time to say anything
        why = reason or (f"it was ended by signal {-status}" if status < 0 else f"exit status {status}")
        return RecorderResult(path=None, rows=0, error=f"the recorder's process died ({why})")


def _last_line(errors: IO[bytes]) -> str:
    """The last line of what a process wrote to standard error, which names the error that ended it."""
    errors.seek(0)
    return (errors.read().decode("utf-8", "replace").strip().splitlines() or [""])[-1]


if __name__ == "__main__":
    sys.exit(main())

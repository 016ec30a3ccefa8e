"""The loop in its own process, as the program sees it: starts it, talks to it, waits for it, and always ends it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import IO, Any, Literal, Self

import servobench.errors as errors
from servobench.channels import DeviceInfo
from servobench.errors import DeviceError, DeviceLost, ServobenchError, StorageError, UsageError
from servobench.experiment import Experiment
from servobench.loop.completion import complete
from servobench.loop.messages import Command, Notice, info_of, info_to_json, stopped_of
from servobench.loop.opening import opening
from servobench.loop.recording_process import PATIENCE, Late, RecorderProcess, RecorderSpec
from servobench.loop.ring import (
    LOOP_STATE,
    OPERATOR_HEARTBEAT,
    RECORD_UNTIL,
    RECORDER_STATE,
    ROWS_KEPT,
    MessageReader,
    MessageRing,
    RowReader,
    RowRing,
)
from servobench.loop.spec import ASKED, COLUMNS, FAILED, STARTING, LoopSpec, WhenFaulted
from servobench.recording.recording import Recording, Stopped

SLOTS = 65536  # rows that a reader may be behind; a minute at 1 kHz
COMMAND_SLOTS = 1024
START_PATIENCE = 120.0  # s; a second interpreter and its kernels, on a busy machine
END_PATIENCE = 10.0  # s; how long a loop that was told to stop may take, before it is killed
LOOK_INTERVAL = 0.02  # s
WAITS_FOR_RECORDER = (
    f"the motor is stopped; waiting for the recorder to finish the file (at most {PATIENCE:g} s)"
)


class LoopProcess:
    """A run in a process of its own; a context manager that leaves the motor at rest.

    Entering starts the recorder (where `record` names a file) and the loop, which opens the device, and waits until the run
    begins. What can't begin raises the error that it would raise here. Leaving ends the run, if it goes on.
    Raises `UsageError` for what is no experiment.

    `when_faulted` "hold" keeps zero volts after a fault until it's acknowledged; `enabled` False begins with zero volts;
    `operator_timeout` [s] stops the motor where `here` isn't called for as long; `unrecorded_goes_on` lets the motor turn where
    the recorder failed, `missed_go_on` where too many ticks are missed; `real_time` False leaves the scheduling alone, `cpu` is
    the processor to stay on.
    """

    def __init__(
        self,
        experiment: Experiment,
        *,
        record: str | os.PathLike[str] | None = None,
        when_faulted: WhenFaulted = "end",
        enabled: bool = True,
        operator_timeout: float | None = None,
        unrecorded_goes_on: bool = False,
        missed_go_on: bool = False,
        real_time: bool = True,
        cpu: int | None = None,
    ) -> None:
        if not isinstance(experiment, Experiment):
            raise UsageError(
                f"{experiment!r} is no experiment; expected an Experiment, such as load_experiment(FILE)"
            )
        self.experiment = experiment
        self._path = None if record is None else Path(record)
        self._rules: dict[str, Any] = {
            "when_faulted": when_faulted,
            "enabled": enabled,
            "operator_timeout": operator_timeout,
            "unrecorded_goes_on": unrecorded_goes_on,
            "missed_go_on": missed_go_on,
            "real_time": real_time,
            "cpu": cpu,
        }
        self._stack = ExitStack()
        self._number = 0
        self._missed_recorder = False
        self._told_open: Notice | None = None
        self._ended: Notice | None = None
        self._giving = Lock()  # one at a time writes to a ring, whatever threads there are
        self._ready: RecorderProcess | None = None  # a recorder that waits to be needed
        self._readying = Lock()
        self._over = False

    def __enter__(self) -> Self:
        """Start it, and wait until the run begins."""
        with ExitStack() as stack:
            self.ring = stack.enter_context(RowRing.create(COLUMNS, SLOTS))
            self._commands = stack.enter_context(MessageRing.create(COMMAND_SLOTS))
            self._events = stack.enter_context(MessageRing.create())
            self._heard = self._events.reader(0)
            self.here()
            self._process = self._started_loop()
            self._recording = self._started_recorder(stack)
            stack.callback(self._end)  # before the recorder's own end, which waits for this
            stack.callback(self._dismiss_the_ready)
            self.info = self._opened()
            self.recording = opening(self.experiment, self.info, commanded_live=True, timing=self.info.timing)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the run, if it goes on, and let go of the rings."""
        self._stack.close()

    @property
    def width(self) -> int:
        """The numbers of a row that are used: the time and a value for each series of `recording`."""
        return 1 + len(self.recording.series)

    def rows(self, start: int | None = None) -> RowReader:
        """Return a reader of the rows, from the oldest that is still there or from that number on."""
        return self.ring.reader(start)

    def events(self, start: int | None = 0) -> MessageReader:
        """Return a reader of the events' texts; `Notice.parse` reads them."""
        return self._events.reader(start)

    def command(self, command: Command) -> int:
        """Give a command and return its number, with which the event that acknowledges it comes."""
        with self._giving:
            self._number += 1
            self._commands.push(command.to_text(self._number))
            return self._number

    def stop(
        self, sentence: str, reason: Literal["finished", "interrupted", "error"] = "interrupted"
    ) -> None:
        """Tell it to end with that sentence; `wait` sees the end."""
        self.command(Command(stop=sentence, reason=reason))

    def here(self) -> None:
        """Show that the operator is there."""
        self.ring.set(OPERATOR_HEARTBEAT, time.monotonic_ns())

    def ready_recorder(self) -> None:
        """Start a recorder for the next `record_from`, which takes it a second or more: that one begins at once then."""
        with self._readying:
            if self._ready is None and not self._over:
                self._ready = RecorderProcess()

    def record_from(
        self, first: int, path: str | os.PathLike[str], experiment: Experiment, duration: float | None = None
    ) -> RecorderProcess:
        """Start a recorder of the rows from number `first` on, for `duration` [s] or until `end_recording`, and return it.

        `experiment` is what the recording is to say that was asked for. One at a time. The loop doesn't look at how it goes:
        whoever asked sees it by the words `RECORDER_STATE` and `ROWS_KEPT` of `ring`.
        """
        late = Late(row=first, event=self._events.written, info=info_to_json(self.info), duration=duration)
        spec = RecorderSpec(
            rows=self.ring.name,
            events=self._events.name,
            path=os.fspath(path),
            experiment=experiment.to_toml(),
            loop=self._process.pid,
            late=late,
            commands=self._commands.name,
        )
        self.ring.set(RECORD_UNTIL, 0)
        self.ring.set(ROWS_KEPT, first)
        self.ring.set(RECORDER_STATE, ASKED)
        recorder = self._taken_recorder()
        recorder.begin(spec)
        return recorder

    def _taken_recorder(self) -> RecorderProcess:
        """The recorder that is ready, or a new one."""
        with self._readying:
            ready, self._ready = self._ready, None
        if ready is not None and ready.running:
            return ready
        if ready is not None:
            ready.dismiss()
        return RecorderProcess()

    def _dismiss_the_ready(self) -> None:
        with self._readying:
            self._over = True
            ready, self._ready = self._ready, None
        if ready is not None:
            ready.dismiss()

    def end_recording(self) -> None:
        """Let the recorder that `record_from` started end with the last row that there is now."""
        self.ring.set(RECORD_UNTIL, max(1, self.ring.written))

    @property
    def pid(self) -> int:
        """The number of the loop's process."""
        return self._process.pid

    @property
    def ended(self) -> Stopped | None:
        """Why it ended; None while it goes on."""
        self._listen()
        if self._ended is not None:
            return stopped_of(self._ended)
        if self._process.poll() is None:
            return None
        self._listen()  # what it said last
        if self._ended is not None:
            return stopped_of(self._ended)
        return Stopped(reason="error", sentence=self._last_words())

    def wait(
        self, meanwhile: Callable[[], None] | None = None, *, say: Callable[[str], None] | None = None
    ) -> Recording:
        """Wait for the end, calling `meanwhile` fifty times a second, and return the recording.

        `say` is told what is waited for, once the motor stands and the file still takes its time.

        Raises as `run` does: `DeviceLost`, which carries the recording, and `StorageError`. Raises `UsageError` where nothing was
        recorded.
        """
        while (stopped := self.ended) is None:
            self._miss_the_recorder()
            if meanwhile is not None:
                meanwhile()
            self._process_waits()
        if self._recording is None:
            raise UsageError("this run wasn't recorded: give `record`")
        recording = self._recorded(*self._recording, stopped, say)
        if stopped.reason == "device_lost":
            raise DeviceLost(stopped.sentence.removeprefix("the device failed: "), recording)
        return recording

    def _recorded(
        self,
        recorder: RecorderProcess,
        spec: RecorderSpec,
        stopped: Stopped,
        say: Callable[[str], None] | None,
    ) -> Recording:
        """The recording in the file, once that is whole; what a recorder that died hadn't written is still in the rings."""
        from servobench.recording.reader import read

        went = recorder.wait(slow=None if say is None else lambda: say(WAITS_FOR_RECORDER))
        if went.error and self.ring.get(RECORDER_STATE) != FAILED:
            went = complete(spec, self.ring, self._events)
        if went.error:
            raise StorageError(went.error)
        if went.path is None:
            raise DeviceError(f"{stopped.sentence}, before there was a sample; nothing was recorded")
        (recording,) = read(went.path)
        return recording

    def _miss_the_recorder(self) -> None:
        """Stop the motor where the recorder's process has died: the loop itself would notice by its silence only."""
        going_on = self._rules["unrecorded_goes_on"] or self._missed_recorder
        if self._recording is not None and not going_on and not self._recording[0].running:
            self._missed_recorder = True
            self.stop("the recorder's process ended; the motor was stopped", "error")

    def _process_waits(self) -> None:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(LOOK_INTERVAL)

    def _started_recorder(self, stack: ExitStack) -> tuple[RecorderProcess, RecorderSpec] | None:
        if self._path is None:
            return None
        spec = RecorderSpec(
            rows=self.ring.name,
            events=self._events.name,
            path=os.fspath(self._path),
            experiment=self.experiment.to_toml(),
            loop=self._process.pid,
            commands=self._commands.name,
        )
        return stack.enter_context(RecorderProcess(spec)), spec

    def _started_loop(self) -> subprocess.Popen[str]:
        spec = LoopSpec(
            experiment=self.experiment.to_toml(),
            rows=self.ring.name,
            commands=self._commands.name,
            events=self._events.name,
            recorded=self._path is not None,
            **self._rules,
        )
        process = subprocess.Popen(
            # -P: nothing that lies in the user's folder is taken for a module.
            [sys.executable, "-P", "-m", "servobench.loop.child"],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        _standard_input(process).write(spec.to_line())
        _standard_input(process).flush()
        return process

    def _opened(self) -> DeviceInfo:
        """Wait until the run begins, and return what the device is; raises what kept it from beginning."""
        deadline = time.monotonic() + START_PATIENCE
        while time.monotonic() < deadline:
            self.here()  # who waits for the run to begin is there
            self._listen_for_a_beginning()
            if self._told_open is not None and self.ring.get(LOOP_STATE) != STARTING:
                return info_of(self._told_open)
            if self._process.poll() is not None:
                self._listen()  # what it said last
                raise DeviceError(self._last_words())
            self._process_waits()
        raise DeviceError(f"the loop's process wasn't there after {START_PATIENCE:g} s; nothing was moved")

    def _listen_for_a_beginning(self) -> None:
        """Listen; raises what kept the run from beginning, the recorder's own word where it is what failed."""
        try:
            self._listen()
        except ServobenchError:
            if self._recording is None or self.ring.get(RECORDER_STATE) != FAILED:
                raise
            went = self._recording[0].wait()
            if not went.error:
                raise
            kind = StorageError if self._recording[0].status == StorageError.exit_status else UsageError
            raise kind(f"{went.error}; nothing was moved") from None

    def _listen(self) -> None:
        for text in self._heard.read():
            event = Notice.parse(text)
            if event.kind == "opened":
                self._told_open = event
            elif event.kind == "ended":
                self._ended = event
            elif event.kind == "failed":
                raise _error(event)

    def _last_words(self) -> str:
        """A sentence about a process that ended without one."""
        said = self._process.stderr.read().strip().splitlines() if self._process.stderr else []
        reason = f": {said[-1]}" if said else ""
        return f"the loop's process ended without a word, with status {self._process.returncode}{reason}"

    def _end(self) -> None:
        """End the process, whatever it is doing; the end of its input tells it that nobody is there."""
        with suppress(OSError):
            _standard_input(self._process).close()
        try:
            self._process.wait(END_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.terminate()
            try:
                self._process.wait(END_PATIENCE)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._process.stderr is not None:
            self._process.stderr.close()


def _standard_input(process: subprocess.Popen[str]) -> IO[str]:
    """The end of a pipe that a process was started with."""
    if process.stdin is None:
        raise DeviceError("the loop's process was started without a standard input")
    return process.stdin


def _error(event: Notice) -> ServobenchError:
    """The error that kept a run from beginning, as the class that it had."""
    kind = getattr(errors, event.about["error"], DeviceError)
    sentence = event.about["sentence"]
    if kind in (UsageError, DeviceError, StorageError, errors.ExperimentError):
        error: ServobenchError = kind(sentence)
        return error
    return UsageError(sentence) if issubclass(kind, UsageError) else DeviceError(sentence)

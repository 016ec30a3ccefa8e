"""The loop's process from the program's side: starts it, communicates with it, waits for it, and always ends it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from threading import Lock
from types import TracebackType
from typing import IO, Any, Literal, Self

import servobench.core.errors as errors
from servobench.core.channels import DeviceInfo
from servobench.core.errors import DeviceError, ServobenchError, StorageError, UsageError
from servobench.core.finding import Finding, Severity
from servobench.recordings.recording import Recording, Stopped
from servobench.rig.devices.base import DEVICES
from servobench.rig.experiment import Experiment
from servobench.rig.loop.chatter import Chatter
from servobench.rig.loop.completion import complete
from servobench.rig.loop.drain import LOOP_DIED, loop_died
from servobench.rig.loop.exit_status import exit_text
from servobench.rig.loop.interrupts import hold_interrupts
from servobench.rig.loop.messages import (
    NOT_CLOSED,
    Command,
    Notice,
    ending_from_json,
    ending_to_json,
    info_of,
    info_to_json,
    stop_reason,
)
from servobench.rig.loop.opening import opening
from servobench.rig.loop.recording_process import PATIENCE, Late, RecorderProcess, RecorderSpec
from servobench.rig.loop.ring import (
    LOOP_STATE,
    OPERATOR_HEARTBEAT,
    RECORD_UNTIL,
    RECORDER_STATE,
    ROWS_KEPT,
    ZERO_VOLTS,
    MessageReader,
    MessageRing,
    RowReader,
    RowRing,
)
from servobench.rig.loop.silence import DEVICE_SILENT, Silence, silence_of, urgent
from servobench.rig.loop.spec import ASKED, COLUMNS, FAILED, NO_RECORDER, STARTING, LoopSpec, WhenFaulted
from servobench.rig.loop.ticks import stop_text
from servobench.rig.lost_device import DeviceLost, DeviceSilent

SLOTS = 65536  # rows that a reader may be behind; a minute at 1 kHz
COMMAND_SLOTS = 1024
START_PATIENCE = 120.0  # s; a second interpreter and its kernels, on a busy machine
END_PATIENCE = 10.0  # s; how long a running loop may take to stop before it is killed
TERM_PATIENCE = 0.4  # s; how long a loop that is silent has for what SIGTERM makes it do, before it is killed
DEATH_PATIENCE = 0.5  # s; a process in the middle of a system call may not even die
LOOK_INTERVAL = 0.02  # s
COMPLETING = "completing the recording"
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
        alarm: Callable[[str], None] | None = None,
    ) -> None:
        if not isinstance(experiment, Experiment):
            raise UsageError(
                f"{experiment!r} isn't an experiment; expected an Experiment, such as servobench.Experiment(duration='5 s')"
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
        self._alarm = alarm or _to_standard_error
        self._alarmed: list[str] = []
        self._begun = self._given_up = self._undead = False
        self._process_begun = self._over_for_good = False
        self._last_silence: Silence | None = None  # the one in which it was ended
        self._danger = ""
        self._confirmed = False
        self._silence: Silence | None = None  # the longest one, where it was told
        self._silence_when_interrupted: Silence | None = None
        self._zero_volts_at_the_end = False
        self._end_asked = False
        self._ending = Lock()
        self._resting = Lock()

    def __enter__(self) -> Self:
        """Start it, and wait until the run begins."""
        try:
            self._begin()
        except KeyboardInterrupt as interrupt:
            silence = self._silence_when_interrupted or self._silence
            if silence is None:
                raise
            silence = replace(silence, zero_volts=self._zero_volts_at_the_end)
            raise DeviceError(f"{silence.sentence}; {stop_text(interrupt)} before it began") from None
        return self

    def _begin(self) -> None:
        asked = self.experiment
        if getattr(
            DEVICES[asked.device.name], "drives", True
        ):  # before anything is started, let alone opened
            asked.limits.watchdog.check_sample_time(asked.sample_time)
        with ExitStack() as stack:
            self.ring = stack.enter_context(RowRing.create(COLUMNS, SLOTS))
            self._commands = stack.enter_context(MessageRing.create(COMMAND_SLOTS))
            self._events = stack.enter_context(MessageRing.create())
            self._heard = self._events.reader(0)
            stack.callback(self._let_go)
            self._begun = True
            self.here()
            self._process = self._start_loop()
            self._process_begun = True
            self._recording = self._start_recorder(stack)
            stack.callback(self._end)  # before the recorder's own end, which waits for this
            stack.callback(self._dismiss_the_ready)
            try:
                self.info = self._wait_until_open()
            except KeyboardInterrupt:
                self._silence_when_interrupted = self._silence  # the end may wake what was silent
                raise
            self.recording = opening(self.experiment, self.info, commanded_live=True, timing=self.info.timing)
            self._stack = stack.pop_all()

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
        self._end_asked = True
        self.command(Command(stop=sentence, reason=reason))

    @property
    def warnings(self) -> tuple[str, ...]:
        """The alarms so far, after a look for new ones; also while the process is being started."""
        if self._begun:
            with suppress(UsageError):  # another thread has closed the ring just now
                self._look_for_silence()
        return tuple(self._alarmed)

    def give_up(self) -> None:
        """Interrupt `__enter__` in another thread: it gets a `DeviceError` instead of waiting for the device."""
        self._given_up = True

    def rest(self) -> None:
        """End the loop at once, from any thread; the context's end tidies up after it. A loop that is silent is killed.

        It also ends one that is being entered: that `__enter__` raises a `DeviceError`.
        """
        self.give_up()
        with suppress(UsageError):  # another thread has closed the ring just now: it has ended
            if self._begun and self._process_begun:
                self._end_loop()

    @property
    def danger(self) -> str:
        """Problems at the motor after the end, in capitals, with what to do; empty if there are none."""
        return self._danger

    @property
    def zero_volts(self) -> bool:
        """Whether zero volts were confirmed at the end."""
        return self._confirmed

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

        `experiment` is what the recording is to say that was requested. One at a time. The loop doesn't look at how it goes:
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
        recorder = self._take_recorder()
        recorder.begin(spec)
        return recorder

    def _take_recorder(self) -> RecorderProcess:
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
        """Its end; None while it goes on."""
        self._listen()
        if self._ended is None and (self._undead or self._process.poll() is not None):
            self._report_unexpected_end()
        return None if self._ended is None else stop_reason(self._ended)

    def _report_unexpected_end(self) -> None:
        """Report to all listeners how a dead loop ended, if it didn't do so itself."""
        with self._ending:
            if self._ended is None:
                self._listen()  # what it said last
            if self._ended is not None:
                return
            silence = self._silence
            silence = silence and self._update_silence(silence)
            finding: Finding = loop_died(self.ring) if silence is None else silence.finding()
            if silence is not None:
                stopped = Stopped(reason="device_lost", sentence=f"the device failed: {silence.sentence}")
            else:
                stopped = Stopped(reason="error", sentence=self._last_words())
            if silence is None and finding.severity is Severity.DANGER:
                self._warn(urgent(f"{stopped.sentence}; zero volts were not confirmed"))
            self._ended = Notice(kind="ended", about=ending_to_json(stopped, (finding,)))
            if self.ring.written:  # otherwise there is nothing to be recorded
                self._events.push(self._ended.to_text())

    def wait(
        self,
        meanwhile: Callable[[], None] | None = None,
        *,
        say: Callable[[str], None] | None = None,
        over: Callable[[str], None] | None = None,
    ) -> Recording:
        """Wait for the end, calling `meanwhile` fifty times a second, and return the recording.

        `say` is told what is waited for, once the motor stands and the file still takes its time. `over` is told at once that
        the motor is stopped, where the run was ended before its time.

        Raises as `run` does: `DeviceLost`, which carries the recording, and `StorageError`; and `DeviceSilent`, a `DeviceLost`,
        where a call of the device didn't return. Raises `UsageError` where nothing was recorded.
        """
        while (stopped := self.ended) is None:
            self._miss_the_recorder()
            silence = self._look_for_silence()
            if silence is not None and (self._end_asked or silence.too_long):
                self._kill()
                continue
            if meanwhile is not None:
                meanwhile()
            self._process_waits()
        self._warn_of_danger()
        if say is not None:
            say(COMPLETING)
        if (
            over is not None
            and stopped.reason != "finished"
            and self.ring.get(ZERO_VOLTS)
            and not self._alarmed
        ):
            over(self._at_rest())
        if self._recording is None:
            raise UsageError("this run wasn't recorded: give `record`")
        recording = self._complete_recording(*self._recording, stopped, say)
        if self._silence is not None:
            raise DeviceSilent(self._update_silence(self._silence).sentence, recording)
        if stopped.reason == "device_lost":
            raise DeviceLost(stopped.sentence.removeprefix("the device failed: "), recording)
        return recording

    def _at_rest(self) -> str:
        """The stop of the motor and its time, as reported by the loop."""
        ended = self._ended
        when = "" if ended is None or ended.tick < 0 else f" from {ended.time:.2f} s on"
        return f"the motor is stopped (zero volts{when})"

    def _complete_recording(
        self,
        recorder: RecorderProcess,
        spec: RecorderSpec,
        stopped: Stopped,
        say: Callable[[str], None] | None,
    ) -> Recording:
        """The recording in the file, once that is whole; what a recorder that died hadn't written is still in the rings."""
        from servobench.recordings.native.reader import read

        went = recorder.wait(slow=None if say is None else lambda: say(WAITS_FOR_RECORDER))
        if went.error and self.ring.get(RECORDER_STATE) != FAILED:
            went = complete(spec, self.ring, self._events)
        if went.error:
            raise StorageError(went.error)
        if went.path is None:
            raise DeviceError(f"{stopped.sentence} before the first sample; nothing was recorded")
        (recording,) = read(went.path)
        return recording

    def _miss_the_recorder(self) -> None:
        """Stop the motor where the recorder's process has died: the loop itself would notice by its silence only."""
        going_on = self._rules["unrecorded_goes_on"] or self._missed_recorder
        if self._recording is not None and not going_on and not self._recording[0].running:
            self._missed_recorder = True
            self.stop("the recorder's process ended; the motor was stopped", "error")

    def _look_for_silence(self) -> Silence | None:
        """Return what the loop waits for, if it is silent, and warn of it; once more where more is known of the motor."""
        if self._over_for_good:  # what its ring says of a call is no longer so
            return None
        silence = silence_of(self.ring, self.experiment.sample_time)
        # Stored before the message: the user may press Ctrl-C before the call that prints it has returned.
        before, self._silence = self._silence, silence
        if silence is not None and (before is None or silence.zero_volts != before.zero_volts):
            self._warn(silence.warning)
        return silence

    def _update_silence(self, silence: Silence) -> Silence:
        """The silence with the present state of the motor: its end may have put out zero volts."""
        return replace(silence, zero_volts=bool(self.ring.get(ZERO_VOLTS)))

    def _warn_of_danger(self) -> None:
        """Report urgent findings of the loop at once."""
        _, findings = ending_from_json(self._ended.about) if self._ended is not None else (None, ())
        for finding in sorted(findings, key=lambda each: each.severity is not Severity.DANGER):
            reported = finding.code in (LOOP_DIED, DEVICE_SILENT)
            if finding.code == NOT_CLOSED or (finding.severity is Severity.DANGER and not reported):
                self._warn(finding.sentence)

    def _danger_text(self) -> str:
        """The urgent action needed at the motor, by the loop's end and its ring; empty if none."""
        if self._last_silence is not None:
            return replace(self._last_silence, zero_volts=self._confirmed).warning
        _, findings = ending_from_json(self._ended.about) if self._ended is not None else (None, ())
        for finding in findings:
            if finding.code == NOT_CLOSED or finding.severity is Severity.DANGER:
                return finding.sentence
        if self._told_open is None or self._confirmed:
            return ""
        return urgent("the loop has ended; zero volts were not confirmed")

    def _let_go(self) -> None:
        self._begun = False  # the rings are about to be closed
        self._zero_volts_at_the_end = bool(self.ring.get(ZERO_VOLTS))

    def _warn(self, sentence: str) -> None:
        if sentence not in self._alarmed:
            self._alarmed.append(sentence)
            self._alarm(sentence)

    def _kill(self) -> None:
        """End the process: by SIGTERM, which breaks many a wait and stops the motor, and where that doesn't help at once."""
        for end, patience in ((self._process.terminate, TERM_PATIENCE), (self._process.kill, DEATH_PATIENCE)):
            end()
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(patience)
                return
        self._undead = True  # in an uninterruptible system call, which isn't waited for

    def _process_waits(self) -> None:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(LOOK_INTERVAL)

    def _start_recorder(self, stack: ExitStack) -> tuple[RecorderProcess, RecorderSpec] | None:
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

    def _start_loop(self) -> subprocess.Popen[bytes]:
        spec = LoopSpec(
            experiment=self.experiment.to_toml(),
            rows=self.ring.name,
            commands=self._commands.name,
            events=self._events.name,
            recorded=self._path is not None,
            **self._rules,
        )
        with hold_interrupts():
            process = subprocess.Popen(
                # -P: nothing that lies in the user's folder counts as a module.
                [sys.executable, "-P", "-m", "servobench.rig.loop.child"],
                stdin=subprocess.PIPE,
                # A driver that prints must neither wait for a full pipe nor get into what this process puts out.
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
            )
        self._chatter = Chatter(_pipe(process.stdout), _show_chatter)
        _pipe(process.stdin).write(spec.to_line().encode())
        _pipe(process.stdin).flush()
        return process

    def _wait_until_open(self) -> DeviceInfo:
        """Wait until the run begins, and return what the device is; raises what kept it from beginning."""
        deadline = time.monotonic() + START_PATIENCE
        while time.monotonic() < deadline:
            self.here()  # who waits for the run to begin is there
            silence = self._look_for_silence()
            if silence is not None and silence.too_long:
                raise DeviceError(f"{silence.sentence}; nothing was begun")
            if self._given_up:
                raise DeviceError("it was ended before the run began; the motor wasn't moved")
            self._listen_for_a_beginning()
            if self._told_open is not None and self.ring.get(LOOP_STATE) != STARTING:
                return info_of(self._told_open)
            self._check_recorder()
            if self._process.poll() is not None:
                self._listen()  # what it said last
                raise DeviceError(self._last_words())
            self._process_waits()
        raise DeviceError(
            f"the loop's process hadn't started after {START_PATIENCE:g} s; the motor wasn't moved"
        )

    def _check_recorder(self) -> None:
        """Raise `StorageError` if the recorder died before it was ready; until then nothing moves."""
        recorder = None if self._recording is None else self._recording[0]
        if recorder is None or recorder.running or self.ring.get(RECORDER_STATE) != NO_RECORDER:
            return
        self.ring.set(RECORDER_STATE, FAILED)  # so that the loop gives up, too
        raise StorageError(f"{recorder.wait().error}; nothing was moved")

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
        reason = f": {self._chatter.last}" if self._chatter.last else ""
        return f"the loop's process ended without a message, {exit_text(self._process.returncode)}{reason}"

    def _end_loop(self) -> None:
        """End the process, whatever it is doing, and note whether it was silent; one thread at a time, and once."""
        with self._resting:
            if not self._over_for_good:
                self._end_asked = True
                self._last_silence = self._end_process()
                self._over_for_good = True

    def _end_process(self) -> Silence | None:
        """End the process; return the silence in which it was ended. It ends with its input."""
        # One that is silent now counts as a device that failed, though the end of its input may wake it.
        silence = None if self._process.poll() is not None else self._look_for_silence()
        with suppress(OSError):
            _pipe(self._process.stdin).close()
        # On Windows this would be the end at once, of a device that is open. A silent loop gets its SIGTERM from _kill.
        if self.ring.get(LOOP_STATE) == STARTING and silence is None and sys.platform != "win32":
            self._process.terminate()  # nothing turns yet, and what it does until then may take long
        deadline = time.monotonic() + END_PATIENCE
        while self._process.poll() is None:
            silence = silence or self._look_for_silence()
            if silence is not None or time.monotonic() > deadline:
                self._kill()
                break
            self._process_waits()
        return silence

    def _end(self) -> None:
        """End the process, and take note of what is known of the motor then."""
        self._end_loop()
        if self.ring.written and self._process.poll() is not None:
            with suppress(ServobenchError):  # its error was reported, or isn't needed
                self._report_unexpected_end()
        self._warn_of_danger()
        self._confirmed = bool(self.ring.get(ZERO_VOLTS))
        self._danger = self._danger_text()
        self._chatter.end()


def _to_standard_error(sentence: str) -> None:
    with suppress(OSError, ValueError):  # nothing reads it
        sys.stderr.write(f"{sentence}\n")
        sys.stderr.flush()


def _show_chatter(line: str) -> None:
    _to_standard_error(f"from the device's driver: {line}")


def _pipe(end: IO[bytes] | None) -> IO[bytes]:
    """The end of a pipe that a process was started with."""
    if end is None:
        raise DeviceError("the loop's process was started without its pipes")
    return end


def _error(event: Notice) -> ServobenchError:
    """The error that kept a run from beginning, as the class that it had."""
    kind = getattr(errors, event.about["error"], DeviceError)
    sentence = event.about["sentence"]
    if kind in (UsageError, DeviceError, StorageError, errors.ExperimentError):
        error: ServobenchError = kind(sentence)
        return error
    return UsageError(sentence) if issubclass(kind, UsageError) else DeviceError(sentence)

"""The loop's own process: `python -m servobench.rig.loop.child`, a `LoopSpec` in one line on its standard input.

It opens the device, runs the ticks, and always stops the motor at the end. The end of its standard input means that the
program that started it is gone. Its exit status is 0 where the run began, and that of the error where it didn't.
"""

from __future__ import annotations

import logging
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from types import FrameType

from servobench.core.channels import DeviceInfo
from servobench.core.errors import DeviceError, ServobenchError, UsageError
from servobench.core.finding import Finding, warning
from servobench.recordings.recording import Stopped
from servobench.rig.clock import Clock, Tick, clock_for
from servobench.rig.clock.wake_up import wake_ups
from servobench.rig.devices.base import Restarting, connect, error_text
from servobench.rig.devices.faulty import with_faults
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.observed import Observed
from servobench.rig.experiment import Experiment, read_experiment
from servobench.rig.loop.account import Account
from servobench.rig.loop.attendants import (
    LOOK_EVERY,
    CommandTaker,
    GuardTeller,
    OperatorWatch,
    ProgramWatch,
    RecorderWatch,
)
from servobench.rig.loop.clock_steps import ClockSteps
from servobench.rig.loop.interrupts import ignore_interrupts
from servobench.rig.loop.last_resort import CallsInRing, LastResort
from servobench.rig.loop.messages import NOT_CLOSED, Notice, ending_to_json, info_to_json
from servobench.rig.loop.missed_ticks import MissedFault, MissedTickRule
from servobench.rig.loop.opening import RowMaker, opening, row_maker
from servobench.rig.loop.place import Place
from servobench.rig.loop.preloading import preload
from servobench.rig.loop.references import References
from servobench.rig.loop.requests import requests_here
from servobench.rig.loop.ring import LOOP_STATE, RECORDER_STATE, MessageRing, RowRing
from servobench.rig.loop.schedule import real_time
from servobench.rig.loop.spec import ASKED, COLUMNS, ENDED, FAILED, RECORDING, RUNNING, LoopSpec
from servobench.rig.loop.ticks import Attendant, Drive, now_and_then, outcome, run_ticks, stop_text
from servobench.systems.control.running import prepare

WAKE_UP_TIME = 0.2  # s; how long the machine's own punctuality is tried
RECORDER_PATIENCE = 30.0  # s; a process that starts on a busy machine
SAME_REQUEST = 0.3  # s; as long as a stop has by itself and by each of its two remedies; what comes later breaks one that hangs


class ToRing:
    """Passes the ticks on through the ring, and keeps account of their timing."""

    def __init__(self, rows: RowRing, row: RowMaker, width: int, account: Account) -> None:
        self._rows = rows
        self._row = row
        self._rest = (0.0,) * (COLUMNS - width)
        self._account = account

    def add(self, place: Place) -> None:
        """Hand on one tick."""
        self._rows.push(self._row(place) + self._rest)
        self._account.add(place.tick)


def main() -> int:
    """Carry out the run that standard input asks for; return the exit status."""
    logging.disable(logging.WARNING)  # the program that started this one gives the same ones
    ignore_interrupts()
    spec = LoopSpec.from_line(sys.stdin.readline())
    with ExitStack() as stack:
        rows = stack.enter_context(RowRing.attach(spec.rows))
        commands = stack.enter_context(MessageRing.attach(spec.commands))
        events = stack.enter_context(MessageRing.attach(spec.events))
        loop = _Loop(spec, rows, commands, events)
        try:
            loop.run()
        except ServobenchError as error:
            loop.tell("failed", error=type(error).__name__, sentence=str(error))
            return error.exit_status
        except KeyboardInterrupt as interrupt:
            loop.tell("failed", error="DeviceError", sentence=f"{stop_text(interrupt)} before it began")
            return DeviceError.exit_status
        finally:
            rows.set(LOOP_STATE, ENDED)
            if rows.get(RECORDER_STATE) != ASKED:  # one that was asked to record clears up itself
                for ring in (rows, commands, events):
                    ring.clear_up()
    return 0


@dataclass(frozen=True)
class _Ending:
    """The end of a run: the reason, the tick, the findings, and the error if one ended it."""

    stopped: Stopped
    tick: Tick | None
    findings: tuple[Finding, ...]
    error: BaseException | None


class _Loop:
    """One run in this process."""

    def __init__(self, spec: LoopSpec, rows: RowRing, commands: MessageRing, events: MessageRing) -> None:
        self._spec = spec
        self._rows = rows
        self._commands = commands
        self._events = events
        self._gone = threading.Event()

    def tell(self, kind: str, at: Tick | None = None, **about: object) -> None:
        """Tell everybody who listens; `at` is the tick that it belongs to."""
        place = {} if at is None else {"tick": at.index, "time": at.actual}
        self._events.push(Notice(kind=kind, about=about, **place).to_text())  # type: ignore[arg-type]

    def run(self) -> None:
        """Open the device, wait for the recorder, let the ticks pass, and tell how it ended."""
        _terminate_like_ctrl_c()
        threading.Thread(target=self._await_the_end_of_input, daemon=True).start()
        experiment = read_experiment(self._spec.experiment, "the experiment")
        device = with_faults(
            connect(experiment.device.name, **experiment.device.settings), experiment.device.faults
        )
        opening_time = device.opening_time if isinstance(device, Restarting) else 0.0
        observer = CallsInRing(self._rows, experiment.sample_time, LastResort(), opening_time)
        guarded = Guarded(Observed(device, observer), experiment.limits, when_faulted=self._spec.when_faulted)
        ending: _Ending | None = None
        try:
            with guarded:
                ending = self._drive(experiment, guarded)
        except BaseException as error:
            if ending is None:
                raise
            ending = replace(ending, findings=(*ending.findings, _not_closed(error)))
        # Only now is it known how the device took the last stop, and whether it could be closed.
        findings = (*ending.findings, *guarded.findings())
        self.tell("ended", ending.tick, **ending_to_json(ending.stopped, findings))
        if ending.error is not None and not isinstance(ending.error, DeviceError):
            raise ending.error

    def _drive(self, experiment: Experiment, device: Guarded) -> _Ending:
        if self._spec.enabled and self._spec.operator_timeout is None:  # otherwise it is driven by hand
            preload(device, experiment)
        clock = _clock(experiment, device.info)
        opened = opening(experiment, device.info, commanded_live=True, timing=clock.timing)
        references = References(experiment.signal, experiment.sample_time)
        drive = Drive(experiment, device, references, enabled=self._spec.enabled)
        account = Account(experiment.sample_time, clock.timing, now=time.perf_counter)
        sink = ToRing(self._rows, row_maker(opened), 1 + len(opened.series), account)
        steps = ClockSteps(experiment.sample_time)
        attendants = self._attendants(experiment, device, drive, steps)
        self.tell("opened", info=info_to_json(device.info), pid=os.getpid())
        self._await_the_recorder()
        prepare()  # a switch of the controller mustn't wait for the compiler
        scheduling = real_time(cpu=self._spec.cpu) if self._spec.real_time else None
        woken = wake_ups(
            experiment.sample_time, round(min(200, max(1, WAKE_UP_TIME / experiment.sample_time)))
        )

        if self._gone.is_set():
            raise DeviceError(
                "the program that started the run ended before the run began; the motor wasn't moved"
            )

        def carry_out() -> Stopped:
            self._rows.set(LOOP_STATE, RUNNING)
            clock.start(experiment.sample_time)
            ended = run_ticks(experiment.samples, device, clock, drive, sink, attendants)
            if ended is None:
                account.complete(experiment.samples)
            return ended or Stopped(
                reason="finished", sentence=f"ran for {experiment.duration:g} s, as asked"
            )

        # Last: from here on a board that keeps the time sends samples, whether or not they are read.
        device.start(experiment.sample_time, experiment.seed)
        stopped, error = outcome(carry_out, device)
        findings = (*opened.findings, *steps.findings(), *account.findings())
        findings = (*findings, *(scheduling.findings() if scheduling else ()), *woken.findings())
        return _Ending(stopped, account.last, findings, error)

    def _attendants(
        self, experiment: Experiment, device: Guarded, drive: Drive, steps: ClockSteps
    ) -> list[Attendant]:
        every_tick = self._make_missed_rule(experiment, device, drive)
        if device.info.timing == "device":
            every_tick.append(steps)
        guard = GuardTeller(device, self._rows, self._events)
        every_tick += [
            guard,
            CommandTaker(self._commands.reader(0), self._events, drive, guard.acknowledge),
        ]
        slow: list[Attendant] = [ProgramWatch(self._gone.is_set)]
        if self._spec.recorded and not self._spec.unrecorded_goes_on:
            slow.append(RecorderWatch(self._rows))
        if self._spec.operator_timeout is not None:
            slow.append(OperatorWatch(self._rows, self._spec.operator_timeout))
        return [*every_tick, *(now_and_then(LOOK_EVERY, experiment.sample_time, each) for each in slow)]

    def _make_missed_rule(self, experiment: Experiment, device: Guarded, drive: Drive) -> list[Attendant]:
        """The action for too many missed ticks: none, a fault that is held, or the end."""
        if self._spec.missed_go_on:
            return []
        rule = MissedTickRule(experiment.sample_time)
        return [MissedFault(rule, device, drive) if self._spec.when_faulted == "hold" else rule]

    def _await_the_recorder(self) -> None:
        """Wait until the recorder is at work: nothing moves before."""
        deadline = time.monotonic() + RECORDER_PATIENCE
        while self._spec.recorded and (state := self._rows.get(RECORDER_STATE)) != RECORDING:
            if state == FAILED:
                raise UsageError("the recorder couldn't start; the motor wasn't moved")
            if time.monotonic() > deadline or self._gone.is_set():
                raise DeviceError(
                    f"the recorder hadn't started after {RECORDER_PATIENCE:g} s; the motor wasn't moved"
                )
            time.sleep(0.005)

    def _await_the_end_of_input(self) -> None:
        while sys.stdin.read(1024):
            pass
        self._gone.set()


def _clock(experiment: Experiment, info: DeviceInfo) -> Clock:
    """The clock of a run in real time."""
    if info.timing == "virtual":
        raise UsageError(
            f"the device {info.name!r} runs in virtual time, which passes as fast as it's computed; a loop in real time needs "
            'timing = "host"'
        )
    return clock_for(info.timing, missed=experiment.when_late.missed, phase=experiment.when_late.phase)


def _terminate_like_ctrl_c(now: Callable[[], float] = time.monotonic) -> None:
    """Let whatever asks the process to end stop the motor first; `now` tells the time [s].

    The same request often comes twice, as from the terminal and from the program that started this one. A second interrupt
    while the first one is on its way out could end the process before the device is stopped, so it waits.
    """
    interrupted = -math.inf

    def interrupt(number: int, frame: FrameType | None) -> None:
        nonlocal interrupted
        if now() - interrupted < SAME_REQUEST:
            return
        interrupted = now()
        raise KeyboardInterrupt(f"{signal.Signals(number).name}, which was sent to the loop's process")

    for request in requests_here():
        signal.signal(request, interrupt)


def _not_closed(error: BaseException) -> Finding:
    return warning(
        NOT_CLOSED,
        f"The device could not be closed ({error_text(error)}) after a stop command. Check its driver, and unplug "
        "the device before the next run if it stays in use.",
    )


if __name__ == "__main__":
    sys.exit(main())

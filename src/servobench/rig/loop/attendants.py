"""The checks at each tick in the loop's own process: for commands, for the recorder, for the operator."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from servobench.core.errors import UsageError
from servobench.recordings.recording import Stopped
from servobench.rig.devices.guard.faults import Fault
from servobench.rig.devices.guarded import Guarded
from servobench.rig.loop.messages import Notice, Order
from servobench.rig.loop.place import Place
from servobench.rig.loop.ring import (
    FAULT,
    OPERATOR_HEARTBEAT,
    RECORDER_HEARTBEAT,
    RECORDER_STATE,
    MessageReader,
    MessageRing,
    RowRing,
)
from servobench.rig.loop.spec import FAILED
from servobench.rig.loop.ticks import Drive

RECORDER_SILENT = 5.0  # s; a slow disk may hold it up for that long, and the ring holds a minute at 1 kHz
LOOK_EVERY = 0.01  # s of the run


class CommandTaker:
    """Takes commands out of their ring, one a tick, and acknowledges each with the tick at which it took effect."""

    def __init__(
        self, commands: MessageReader, events: MessageRing, drive: Drive, acknowledge: Callable[[], None]
    ) -> None:
        self._commands = commands
        self._events = events
        self._drive = drive
        self._acknowledge = acknowledge
        self._texts: list[str] = []
        self._waiting: list[Order] = []

    def __call__(self, place: Place) -> Stopped | None:
        """Take the next command, if there is one; returns why the run ends, where it does."""
        while self._waiting and self._waiting[0].number <= place.command:
            self._answer(place, self._waiting.pop(0))
        if not self._texts and self._commands.waiting:
            self._texts = self._commands.read()
        return self._take(self._texts.pop(0), place) if self._texts else None

    def _take(self, text: str, place: Place) -> Stopped | None:
        try:
            order = Order.parse(text)
        except UsageError as error:
            about = {"number": None, "accepted": False, "what": text, "why": str(error)}
            self._tell(place, about)
            return None
        if order.command.stop is not None:
            self._answer(place, order)
            return Stopped(reason=order.command.reason, sentence=order.command.stop)
        if order.command.acknowledge:
            self._acknowledge()
        self._drive.change(order)
        self._waiting.append(order)
        return None

    def _answer(self, place: Place, order: Order) -> None:
        what = order.command.model_dump(mode="json", exclude_defaults=True)
        why = self._drive.refused.pop(order.number, "")
        self._tell(place, {"number": order.number, "accepted": not why, "what": what, "why": why})

    def _tell(self, place: Place, about: Mapping[str, object]) -> None:
        event = Notice(kind="command", tick=place.tick.index, time=place.tick.actual, about=about)
        self._events.push(event.to_text())


class GuardTeller:
    """Tells of a fault that the guard has latched, and of its acknowledgement."""

    def __init__(self, device: Guarded, rows: RowRing, events: MessageRing) -> None:
        self._device = device
        self._rows = rows
        self._events = events
        self._reported: Fault | None = None
        self._place: Place | None = None

    def __call__(self, place: Place) -> Stopped | None:
        """Tell of a fault of the guard, once; never ends the run."""
        self._place = place
        fault = self._device.fault
        if fault is not self._reported:
            self._reported = fault
            self._rows.set(FAULT, fault is not None)
            if fault is not None:
                self._tell("fault", {"code": fault.code, "sentence": fault.sentence})
        return None

    def acknowledge(self) -> None:
        """Acknowledge the fault, if there is one."""
        fault = self._device.fault
        if fault is not None:
            self._device.acknowledge()
            self._reported = None
            self._rows.set(FAULT, 0)
            self._tell("acknowledged", {"code": fault.code})

    def _tell(self, kind: Literal["fault", "acknowledged"], about: Mapping[str, object]) -> None:
        if self._place is not None:
            tick = self._place.tick
            self._events.push(Notice(kind=kind, tick=tick.index, time=tick.actual, about=about).to_text())


@dataclass
class RecorderWatch:
    """Ends the run if the recorder failed or is silent, unless the run may go on unrecorded.

    `rows` is the ring that it reads, `now` the monotonic time [ns].
    """

    rows: RowRing
    now: Callable[[], int] = time.monotonic_ns

    def __call__(self, place: Place) -> Stopped | None:
        """Return why the run ends where the recorder no longer works, None where it does."""
        if self.rows.get(RECORDER_STATE) == FAILED:
            return Stopped(reason="error", sentence="nothing more could be recorded; the motor was stopped")
        if self.now() - self.rows.get(RECORDER_HEARTBEAT) > RECORDER_SILENT * 1e9:
            return Stopped(
                reason="error",
                sentence=f"no sign of the recorder for more than {RECORDER_SILENT:g} s; the motor was stopped",
            )
        return None


@dataclass
class OperatorWatch:
    """Ends the run if no operator has reported for `timeout` [s].

    `rows` is the ring in which the operator leaves a mark, `now` the monotonic time [ns].
    """

    rows: RowRing
    timeout: float
    now: Callable[[], int] = time.monotonic_ns

    def __call__(self, place: Place) -> Stopped | None:
        """Return why the run ends if the operator is gone, otherwise None."""
        if self.now() - self.rows.get(OPERATOR_HEARTBEAT) <= self.timeout * 1e9:
            return None
        return Stopped(
            reason="interrupted",
            sentence=f"no sign of the operator for {self.timeout:g} s; the motor was stopped",
        )


@dataclass
class ProgramWatch:
    """Ends the run where the program that started it is gone."""

    gone: Callable[[], bool]

    def __call__(self, place: Place) -> Stopped | None:
        """Return why the run ends where the program is gone, None where it is there."""
        if not self.gone():
            return None
        return Stopped(
            reason="interrupted", sentence="the program that started the run has ended; the motor was stopped"
        )

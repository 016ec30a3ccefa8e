"""A loop that is none: it acknowledges each command at once, and puts out what it was told, in rows that a test asks for."""

from __future__ import annotations

import json
import struct
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

from servobench.core.channels import Channel, DeviceInfo
from servobench.recordings.recording import Stopped
from servobench.rig.experiment import Experiment
from servobench.rig.loop.messages import Command, Notice
from servobench.rig.loop.opening import opening
from servobench.rig.loop.recording_process import RecorderProcess
from servobench.rig.loop.ring import MessageReader, MessageRing, RowReader, RowRing
from servobench.rig.loop.spec import COLUMNS

INFO = DeviceInfo(
    name="double",
    channels=(
        Channel(name="voltage", unit="V", minimum=-10.0, maximum=10.0),
        Channel(name="counts", unit="counts", counter_bits=16, counts_per_rev=2048.0, resolution=1.0),
    ),
    timing="host",
)


class LoopDouble:
    """Takes commands as the real loop does; `commands` are those that came, `signs` how often somebody was there."""

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.info = INFO
        self.recording = opening(experiment, INFO, commanded_live=True, timing="host")
        self.commands: list[Command] = []
        self.signs = 0
        self.enabled = False
        self.ended: Stopped | None = None
        self.warnings: tuple[str, ...] = ()
        self.entered = self.left = False
        self.danger, self.zero_volts = "", True  # what its end says of the motor
        self.rested = 0  # how often it was ended
        self._rings = ExitStack()
        self._tick = 0

    def __enter__(self) -> Self:
        self.ring = self._rings.enter_context(RowRing.create(COLUMNS, 1024))
        self._events = self._rings.enter_context(MessageRing.create(16384))
        self.entered = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.left = True
        self._rings.close()

    def rest(self) -> None:
        self.rested += 1

    def rows(self, start: int | None = None) -> RowReader:
        return self.ring.reader(start)

    def events(self, start: int | None = 0) -> MessageReader:
        return self._events.reader(start)

    def command(self, command: Command) -> int:
        self.commands.append(command)
        number = len(self.commands)
        what = json.loads(command.to_text(number))
        del what["number"]
        if command.enabled is not None:
            self.enabled = command.enabled
        self.say("command", number=number, accepted=True, what=what, why="")
        return number

    def say(self, kind: Any, **about: object) -> None:
        self._events.push(Notice(kind=kind, tick=self._tick, time=0.0, about=about).to_text())

    def here(self) -> None:
        self.signs += 1

    def tick(self, counts: int = 0, late: bool = False, skipped: int = 0, saturated: bool = False) -> None:
        """Let one tick pass, after some that are missed."""
        self._tick += skipped
        t = self._tick * self.experiment.sample_time
        volts = 1.0 if self.enabled else 0.0
        values = {
            "commanded": volts,
            "applied": volts,
            "counts": counts,
            "scheduled": t,
            "late": float(late),
            "saturated": float(saturated),
            "written": t,
            "reference": 1.0,
            "command": len(self.commands),
        }
        row = [t, *(values.get(series.channel.name, t) for series in self.recording.series)]
        self.ring.push([*row, *[0.0] * (COLUMNS - len(row))])
        self._tick += 1

    def ready_recorder(self) -> None:
        """Get nothing ready."""

    def record_from(
        self, first: int, path: str, experiment: Experiment, duration: float | None = None
    ) -> RecorderProcess:
        raise NotImplementedError("the double records nothing")

    def end_recording(self) -> None:
        raise NotImplementedError("the double records nothing")


def rows_until(frame: bytes) -> int:
    """The number of the row after a frame's last one, which a page that has drawn it says in its beat."""
    count, _, _, first = struct.unpack_from("<IIId", frame, 4)
    return int(first) + int(count)


def unidentified(loop: object, sample_time: float, wish: object) -> None:
    """Identify nothing: a process for each double would take longer than all tests."""

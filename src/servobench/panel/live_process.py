"""Live identification in a process of its own: it reads the loop's ring itself, so neither the loop nor the server waits for it.

`python -m` this module. It gets one line of JSON on standard input (`LiveSpec`), and the end of its input is its end. Just before
each moment of the panel's beat it looks at the rows that have come, and publishes what became of them in a ring of its own, where
whoever makes the next frame finds it.
"""

from __future__ import annotations

import json
import logging
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from tempfile import TemporaryFile
from threading import Event, Thread
from typing import IO, TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np

from servobench.core.channels import Array, DeviceInfo
from servobench.core.json_numbers import finite
from servobench.panel.frame_clock import FrameClock
from servobench.panel.low_priority import FLAGS, give_way, surroundings
from servobench.recordings.recording import Recording
from servobench.rig.loop.messages import info_from_json, info_to_json
from servobench.rig.loop.ring import MessageRing, RowReader, RowRing

if TYPE_CHECKING:
    from servobench.panel.live import LiveFit

LEAD = 0.006  # s; a look takes 1 to 3 ms
PATIENCE = 0.012  # s; how long a frame waits for a look that is late
_AGAIN = 0.002  # s between two looks at whether it has come
_SILENT = 30  # looks without an answer, before it's asked whether the process lives
_MOST = 4096  # rows of a look
_DYING = 0.1  # s; a process that is killed takes much less to be gone
_LOOKED_AT = ("t", "applied", "counts", "handed", "written", "received")
_RESIDUALS = 61  # in a record of the ring, behind `reached`, `first` and their number


class Look(NamedTuple):
    """The outcome of a look.

    Residuals (N,) of rows from number `first` on [rad], NaN where there are none; `reached` is the number of the first row that
    may get one later.
    """

    reached: int
    first: int
    residuals: Array

    def records(self) -> list[Array]:
        """Return it as records (64,) of a ring: `reached`, `first`, N, then the N residuals, 61 at most."""
        records = []
        for begin in range(0, max(len(self.residuals), 1), _RESIDUALS):
            part = self.residuals[begin : begin + _RESIDUALS]
            record = np.zeros(3 + _RESIDUALS)
            record[:3] = self.reached, self.first + begin, len(part)
            record[3 : 3 + len(part)] = part
            records.append(record)
        return records

    @classmethod
    def of(cls, record: Array) -> Look:
        """Return what a record (64,) says."""
        reached, first, count = record[:3].astype(np.int64).tolist()
        return cls(reached=reached, first=first, residuals=record[3 : 3 + count])


@dataclass(frozen=True, kw_only=True)
class LiveSpec:
    """The settings of the process.

    The names of the rings: the loop's rows, those that it publishes what it has seen and its messages in, and that of wishes;
    the columns in which the loop's rows have `t`, `applied`, `counts` and the times of writing; the device's info as JSON holds
    it; the sample time [s], and the first wish.
    """

    rows: str
    seen: str
    messages: str
    wishes: str
    columns: Mapping[str, int]
    info: Any
    sample_time: float
    wish: Mapping[str, float]


class IdentifiedLoop(Protocol):
    """A loop, as far as it is identified: the info of its device, its recording without rows, and the ring with the rows."""

    info: DeviceInfo
    recording: Recording
    ring: RowRing


class LiveProcess:
    """The process, as the server sees it: `look` takes what it has published, `close` ends it. One thread at a time looks."""

    def __init__(self, loop: IdentifiedLoop, sample_time: float, wish: Mapping[str, float]) -> None:
        names = ["t", *(series.channel.name for series in loop.recording.series)]
        with ExitStack() as stack:
            self._ring = stack.enter_context(RowRing.create(3 + _RESIDUALS, 1024))
            self._messages = stack.enter_context(MessageRing.create(16))
            self._wishes = stack.enter_context(MessageRing.create(16))
            self._errors = stack.enter_context(TemporaryFile())
            spec = LiveSpec(
                rows=loop.ring.name,
                seen=self._ring.name,
                messages=self._messages.name,
                wishes=self._wishes.name,
                columns={name: names.index(name) for name in _LOOKED_AT if name in names},
                info=info_to_json(loop.info),
                sample_time=sample_time,
                wish=dict(wish),
            )
            self._process = _start(spec, self._errors)
            stack.callback(self._end)
            self._stack = stack.pop_all()
        self._seen, self._said = self._ring.reader(0), self._messages.reader(0)
        self._silent = 1
        self._status: int | None = None

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    def set_wish(self, wish: Mapping[str, float]) -> None:
        """Say how well the parameters are to be known; it hears it at its next look."""
        self._wishes.push(json.dumps(dict(wish)))

    def look(self, patience: float = PATIENCE) -> list[Look]:
        """Return what it has published since the last look.

        Where it is late it is waited for `patience` [s] at most, and not at all where it was late before.
        """
        records = self._seen.read()
        until = time.perf_counter() + patience
        while not len(records) and not self._silent and time.perf_counter() < until:
            time.sleep(_AGAIN)
            records = self._seen.read()
        self._silent = 0 if len(records) else self._silent + 1
        if self._silent % _SILENT == 0 and self._silent:
            self._status = self._process.poll()
        return [Look.of(record) for record in records]

    def message(self) -> str:
        """Return the newest `live` message of `LiveFit`, as JSON; empty where there is none since the last."""
        return messages[-1] if (messages := self._said.read()) else ""

    @property
    def ended(self) -> str:
        """A sentence about how it ended by itself; empty while it hasn't."""
        if self._status is None:
            return ""
        self._errors.seek(0)
        error_lines = self._errors.read().decode("utf-8", "replace").strip().splitlines()
        return (
            f"Live identification has ended ({error_lines[-1][:200] if error_lines else f'status {self._status}'}). Scopes and "
            "recordings still work: make a recording and identify that, or open the device again."
        )

    def close(self) -> None:
        """End it; may be called twice."""
        self._stack.close()

    def _end(self) -> None:
        self._process.kill()  # it has nothing to save
        self._process.wait()
        with suppress(OSError):
            _pipe(self._process.stdin).close()


def _start(spec: LiveSpec, errors: IO[bytes]) -> subprocess.Popen[bytes]:
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "servobench.panel.live_process"],
        stdin=subprocess.PIPE,
        stderr=errors,
        start_new_session=True,
        env=surroundings(),
        creationflags=FLAGS,
    )
    with suppress(OSError):  # it is dead already, which `ended` tells
        _pipe(process.stdin).write(json.dumps(asdict(spec)).encode() + b"\n")
        _pipe(process.stdin).flush()
    return process


def live_of(loop: IdentifiedLoop, sample_time: float, wish: Mapping[str, float]) -> LiveProcess | None:
    """Return what identifies a loop's device while it runs; None where it can't be, as the device doesn't tell its angle.

    The loop's sample time is in s.
    """
    encoder = loop.info.channel("counts")
    return LiveProcess(loop, sample_time, wish) if encoder is not None and encoder.counts_per_rev else None


def _pipe(end: IO[bytes] | None) -> IO[bytes]:
    """An end of a process that was started with one."""
    return cast("IO[bytes]", end)


def main() -> int:
    """Identify as the line on standard input says, until its end."""
    logging.disable(logging.WARNING)  # the program that started this one gives the same ones
    server = os.getppid()
    give_way()
    from servobench.panel.live import LiveFit

    spec = LiveSpec(**json.loads(sys.stdin.buffer.readline()))
    gone = Event()
    Thread(target=_await_the_end_of_input, args=(gone,), daemon=True).start()
    live = LiveFit(info_from_json(spec.info), spec.sample_time, spec.wish)
    with ExitStack() as stack:
        # Its own rings first: where the panel was killed meanwhile the loop's are gone, and these are still to be cleared up.
        residuals = stack.enter_context(RowRing.attach(spec.seen))
        messages = stack.enter_context(MessageRing.attach(spec.messages))
        wishes = stack.enter_context(MessageRing.attach(spec.wishes))
        wished = wishes.reader(0)
        for ring in (residuals, messages, wishes):
            stack.callback(ring.clear_up)
        rows = stack.enter_context(RowRing.attach(spec.rows)).reader()
        beat = FrameClock(LEAD)
        while not gone.wait(beat.wait()):
            for wish in wished.read():
                live.set_wish(json.loads(wish))
            estimate = look(live, rows, spec.columns, residuals)
            if estimate is not None:
                messages.push(json.dumps(finite(estimate), allow_nan=False, separators=(",", ":")))
        _await_another_parent(server)
    return 0


def look(live: LiveFit, reader: RowReader, columns: Mapping[str, int], to: RowRing) -> dict[str, Any] | None:
    """Give what is new in a ring of rows to a `LiveFit`, publish its residuals, and return its message where one is due."""
    before, estimate = live.reached, None
    rows = reader.read(_MOST)
    if len(rows):
        estimate = live.take({name: rows[:, k] for name, k in columns.items()}, reader.next - len(rows))
    reached = live.reached
    first = max(before, reached - 2 * _MOST)  # rows that were lost are no news
    for record in Look(reached=reached, first=first, residuals=live.residuals(first, reached)).records():
        to.push(record.tolist())
    return estimate


def _await_another_parent(server: int) -> None:
    """Wait a moment for the server to be dead, where it is about to be: its files are closed before its children lose it."""
    until = time.monotonic() + _DYING
    while os.getppid() == server and time.monotonic() < until:
        time.sleep(_AGAIN)


def _await_the_end_of_input(gone: Event) -> None:
    while sys.stdin.buffer.read(1024):
        pass
    gone.set()


if __name__ == "__main__":
    sys.exit(main())

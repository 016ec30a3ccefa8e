"""Live identification in a process of its own: it reads the loop's ring itself, and neither loop nor server waits for it.

`python -m` this module. It gets one line of JSON on standard input (`LiveSpec`), then a line for each look: empty, or a wish as
JSON. It answers each on standard output in binary (`Seen`). The end of its input is its end.
"""

from __future__ import annotations

import json
import os
import struct
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from queue import Empty, SimpleQueue
from tempfile import TemporaryFile
from threading import Thread
from typing import IO, Any, Protocol, Self, cast

import numpy as np

from servobench.channels import Array, DeviceInfo
from servobench.loop.messages import info_from_json, info_to_json
from servobench.loop.ring import RowReader, RowRing
from servobench.recording.recording import Recording

PATIENCE = 0.015  # s that a look waits for its answer, which usually takes 1 to 3 ms
_MOST = 4096  # rows of a look
_NICER = 10  # what runs beside has the processor first
_HEADER = struct.Struct("<QQII")


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What a look came to.

    Residuals (N,) of rows from number `first` on [rad], NaN where there are none; `reached` is the number of the first row that
    may get one later. `message` is the `live` message of `LiveFit` as JSON, empty where none is due.
    """

    reached: int
    first: int
    residuals: Array
    message: str = ""

    def to_bytes(self) -> bytes:
        """Return little-endian u64 `reached`, u64 `first`, u32 N, u32 size of the message; then the f64s and the message."""
        text = self.message.encode()
        header = _HEADER.pack(self.reached, self.first, len(self.residuals), len(text))
        return header + self.residuals.astype("<f8").tobytes() + text

    @classmethod
    def from_file(cls, file: IO[bytes]) -> Self | None:
        """Read the next one; None at the end."""
        header = file.read(_HEADER.size)
        if len(header) < _HEADER.size:
            return None
        reached, first, count, size = _HEADER.unpack(header)
        rest = file.read(8 * count + size)
        if len(rest) < 8 * count + size:
            return None
        residuals = np.frombuffer(rest, "<f8", count)
        return cls(reached=reached, first=first, residuals=residuals, message=rest[8 * count :].decode())


@dataclass(frozen=True, kw_only=True)
class LiveSpec:
    """What it has to know: the ring's name, where in its rows `t`, `applied` and `counts` are, the device as JSON holds it."""

    rows: str
    columns: Mapping[str, int]
    info: Any
    sample_time: float
    wish: Mapping[str, float]


class Identified(Protocol):
    """A loop, as far as it is identified."""

    info: DeviceInfo
    recording: Recording
    ring: RowRing


class LiveProcess:
    """The process, as the server sees it: `look` asks and takes answers, `close` ends it. One thread at a time looks."""

    def __init__(self, loop: Identified, sample_time: float, wish: Mapping[str, float]) -> None:
        names = ["t", *(series.channel.name for series in loop.recording.series)]
        spec = LiveSpec(
            rows=loop.ring.name,
            columns={name: names.index(name) for name in ("t", "applied", "counts")},
            info=info_to_json(loop.info),
            sample_time=sample_time,
            wish=dict(wish),
        )
        self._errors = TemporaryFile()  # noqa: SIM115 - closed in `close`
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "servobench.panel.live_process"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            start_new_session=True,
            # Threads of the linear algebra would spin on processors that others need, for matrices of 8 by 8.
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )
        self._wish: Mapping[str, float] | None = None
        self._asked = 0
        self._answers: SimpleQueue[Seen | None] = SimpleQueue()
        self._ended = self._closed = False
        self._write(json.dumps(asdict(spec)))
        Thread(target=self._listen, name="servobench live", daemon=True).start()

    @property
    def pid(self) -> int:
        """The number of the process."""
        return self._process.pid

    def set_wish(self, wish: Mapping[str, float]) -> None:
        """Say how well the parameters are to be known; the next look says so."""
        self._wish = wish

    def look(self, patience: float = PATIENCE) -> list[Seen]:
        """Have it look at the rows that there are, and return its answers, old ones that came late and this one.

        It is waited for `patience` [s] at most, and not at all where it is still busy with a look before.
        """
        seen = self._taken(0.0)
        if self._asked or self._ended:
            return seen
        wish, self._wish = self._wish, None
        self._write("" if wish is None else json.dumps(wish))
        self._asked += 1
        return seen + self._taken(patience)

    @property
    def ended(self) -> str:
        """A sentence about how it ended by itself; empty while it hasn't."""
        if not self._ended or self._closed:
            return ""
        status = self._process.wait()
        self._errors.seek(0)
        said = self._errors.read().decode("utf-8", "replace").strip().splitlines() or [f"status {status}"]
        return (
            f"Live identification has ended ({said[-1][:200]}). Scopes and recordings go on: record, and identify "
            "the recording; or open the device again."
        )

    def close(self) -> None:
        """End it; may be called twice."""
        if self._closed:
            return
        self._closed = True
        self._process.kill()  # it has nothing to save
        self._process.wait()
        with suppress(OSError):
            _pipe(self._process.stdin).close()
        self._errors.close()

    def _write(self, line: str) -> None:
        with suppress(OSError):  # it is dead already, which `ended` tells
            _pipe(self._process.stdin).write(line.encode() + b"\n")
            _pipe(self._process.stdin).flush()

    def _taken(self, patience: float) -> list[Seen]:
        """The answers that there are; one that is due is waited for."""
        seen: list[Seen] = []
        with suppress(Empty):
            while self._asked:
                answer = self._answers.get(timeout=patience) if patience else self._answers.get_nowait()
                if answer is None:
                    self._ended, self._asked = True, 0
                    break
                self._asked -= 1
                seen.append(answer)
        return seen

    def _listen(self) -> None:
        with _pipe(self._process.stdout) as said:
            while (answer := Seen.from_file(said)) is not None:
                self._answers.put(answer)
        self._answers.put(None)


def live_of(loop: Identified, sample_time: float, wish: Mapping[str, float]) -> LiveProcess | None:
    """Return what identifies a loop's device while it runs; None where it can't be, as the device doesn't tell its angle."""
    encoder = loop.info.channel("counts")
    return LiveProcess(loop, sample_time, wish) if encoder is not None and encoder.counts_per_rev else None


def _pipe(end: IO[bytes] | None) -> IO[bytes]:
    """An end of a process that was started with one."""
    return cast("IO[bytes]", end)


def main() -> int:
    """Identify as the first line on standard input says, until its end."""
    if hasattr(os, "nice"):
        with suppress(OSError):
            os.nice(_NICER)
    from servobench.panel.live import LiveFit

    spec = LiveSpec(**json.loads(sys.stdin.buffer.readline()))
    live = LiveFit(info_from_json(spec.info), spec.sample_time, spec.wish)
    with RowRing.attach(spec.rows) as ring:
        rows = ring.reader()
        for line in sys.stdin.buffer:
            if line.strip():
                live.set_wish(json.loads(line))
            sys.stdout.buffer.write(looked(live, rows, spec.columns).to_bytes())
            sys.stdout.buffer.flush()
    return 0


def looked(live: Any, reader: RowReader, columns: Mapping[str, int]) -> Seen:
    """Give what is new in a ring to a `LiveFit`, and return what it made of it."""
    before = live.reached
    rows = reader.read(_MOST)
    told = None
    if len(rows):
        told = live.take({name: rows[:, k] for name, k in columns.items()}, reader.next - len(rows))
    reached = live.reached
    first = max(before, reached - 2 * _MOST)  # rows that were lost are no news
    return Seen(
        reached=reached,
        first=first,
        residuals=live.residuals(first, reached),
        message="" if told is None else json.dumps(finite(told), allow_nan=False, separators=(",", ":")),
    )


def finite(told: Any) -> Any:
    """A message as JSON can hold it: None in the place of numbers that aren't finite, as of an interval without an end."""
    if isinstance(told, Mapping):
        return {key: finite(value) for key, value in told.items()}
    if isinstance(told, list):
        return [finite(value) for value in told]
    return None if isinstance(told, float) and not np.isfinite(told) else told


if __name__ == "__main__":
    sys.exit(main())

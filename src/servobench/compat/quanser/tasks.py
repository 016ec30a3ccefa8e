"""Tasks: what a board samples, or puts out, at the ticks of a clock, with a buffer between it and the program."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from servobench.compat.quanser.enumerations import ENDLESS, BufferOverflowMode
from servobench.compat.quanser.errors import Code, hil_error

Row: TypeAlias = tuple[tuple[float, ...], ...]
"""The values of a tick, by the four groups of channels."""

FASTEST = 10_000.0  # Hz
_ALMOST = 1e-9  # s; two sums of the same tick differ by rounding


@dataclass(frozen=True, kw_only=True)
class Groups:
    """Channels by the four kinds: analog, `second` (encoders of inputs, PWM of outputs), digital, and other ones."""

    analog: tuple[int, ...] = ()
    second: tuple[int, ...] = ()
    digital: tuple[int, ...] = ()
    other: tuple[int, ...] = ()

    def __iter__(self) -> Iterator[tuple[int, ...]]:
        return iter((self.analog, self.second, self.digital, self.other))


@dataclass(eq=False)
class Task:
    """A task: its `kind`, the `groups` of its channels, the `size` of its buffer, and what a tick does: `latch` or `put`.

    `simulated` says whether the board is one of Quanser's simulator, `mode` what a full buffer does, `overflows` how often it was
    full. It is `running` from start to stop, `failed` where an overflow ended it, and `deleted` at the end.
    """

    kind: Literal["reader", "writer"]
    groups: Groups
    size: int
    simulated: bool
    latch: Callable[[Groups], Row]
    put: Callable[[Groups, Row], None]
    mode: int = BufferOverflowMode.ERROR_ON_OVERFLOW
    overflows: int = 0
    running: bool = False
    deleted: bool = False
    failed: bool = False
    buffer: deque[Row] = field(default_factory=deque)
    _start: float = 0.0
    _period: float = math.inf
    _done: int = 0
    _limit: float = 0

    def set_mode(self, mode: int) -> None:
        """Say what a full buffer does; two of the modes exist for simulated boards alone."""
        if mode not in range(5):
            raise hil_error(Code.INVALID_ARGUMENT, f"the overflow mode is {mode!r}; 0 to 4 are known.")
        if mode >= BufferOverflowMode.WAIT_ON_OVERFLOW and not self.simulated:
            raise hil_error(
                Code.NOT_SUPPORTED, "that overflow mode is for boards of Quanser's simulator alone."
            )
        self.mode = mode

    def start(self, now: float, frequency: float, samples: int) -> None:
        """Tick from now on with a frequency [Hz], for a number of samples; the first tick is a period away."""
        if not frequency > 0.0:
            raise hil_error(Code.FREQUENCY_NOT_POSITIVE, f"the frequency is {frequency!r} Hz.")
        if frequency > FASTEST:
            raise hil_error(
                Code.FREQUENCY_TOO_HIGH, f"the frequency is {frequency!r} Hz; {FASTEST:g} is the highest."
            )
        self._start, self._period, self._done = now, 1.0 / frequency, 0
        self._limit = math.inf if samples < 0 or samples >= ENDLESS else samples
        self.running, self.failed = True, False
        if self.kind == "reader":
            self.buffer.clear()

    def stop(self) -> None:
        """Tick no more; what is in the buffer stays there."""
        self.running = False

    def due(self) -> float:
        """Return the time of the next tick [s], infinite where there is none."""
        waits = self.is_held() if self.kind == "reader" else not self.buffer
        if not self.running or self.failed or self._done >= self._limit or waits:
            return math.inf
        return self._tick(self._done + 1)

    def time_of(self, count: int) -> float:
        """Return the time at which a reader's buffer holds that many samples, or a writer's has room for them [s]."""
        missing = count - (len(self.buffer) if self.kind == "reader" else self.size - len(self.buffer))
        return self._tick(int(min(self._done + max(missing, 0), self._limit)))

    @property
    def started(self) -> bool:
        """Whether it was ever started."""
        return self._period < math.inf

    def is_held(self) -> bool:
        """Return whether a simulated board waits for the program to make room."""
        return self.mode >= BufferOverflowMode.WAIT_ON_OVERFLOW and len(self.buffer) >= self.size

    def is_over(self) -> bool:
        """Return whether no further tick comes."""
        return not self.running or self.failed or self._done >= self._limit

    def tick(self) -> None:
        """Take or put out a sample."""
        self._done += 1
        if self.kind == "writer":
            self.put(self.groups, self.buffer.popleft())
        elif len(self.buffer) < self.size:
            self.buffer.append(self.latch(self.groups))
        else:
            self._overflow()

    def take(self, count: int, now: float) -> list[Row]:
        """Return samples from the buffer; raises `HILError` where it overflowed, once."""
        if self.failed:
            self.running, self.failed = False, False
            raise hil_error(Code.BUFFER_OVERFLOW, f"it holds {self.size} samples.")
        held = self.is_held()
        rows = [self.buffer.popleft() for _ in range(min(count, len(self.buffer)))]
        if held:
            self._start = now - self._done * self._period
        return rows

    def give(self, row: Row, now: float) -> None:
        """Put a sample into a writer's buffer; raises `HILError` where a tick came before it."""
        late = now - self._tick(self._done + 1)
        if not self.buffer and late > _ALMOST:
            self._start = now - self._done * self._period
            if self._done:
                self.overflows += 1
                if self.mode == BufferOverflowMode.ERROR_ON_OVERFLOW and not self.simulated:
                    self.running = False
                    raise hil_error(Code.BUFFER_OVERFLOW, "there was nothing more to write at a tick.")
        self.buffer.append(row)

    def _overflow(self) -> None:
        self.overflows += 1
        if self.mode == BufferOverflowMode.ERROR_ON_OVERFLOW:
            self.failed = True
        elif self.mode == BufferOverflowMode.OVERWRITE_ON_OVERFLOW:
            self.buffer.popleft()
            self.buffer.append(self.latch(self.groups))

    def _tick(self, number: int) -> float:
        return self._start + number * self._period


@dataclass(frozen=True)
class Pair:
    """A task that reads and writes: a reader and a writer that tick together."""

    reader: Task
    writer: Task


def require(task: object) -> Task | Pair:
    """Return a task; raises `HILError` for what is none, or was deleted."""
    if task is None:
        raise hil_error(Code.TASK_IS_NULL)
    if not isinstance(task, Task | Pair) or parts(task)[0].deleted:
        raise hil_error(Code.INVALID_TASK)
    return task


def parts(task: Task | Pair) -> tuple[Task, ...]:
    """Return the tasks that a task is made of."""
    return (task,) if isinstance(task, Task) else (task.reader, task.writer)


def reader_of(task: object) -> Task:
    """Return the reader of a task; raises `HILError` where it has none."""
    task_or_pair = require(task)
    reader = task_or_pair.reader if isinstance(task_or_pair, Pair) else task_or_pair
    if reader.kind == "writer":
        raise hil_error(Code.READING_FROM_WRITER)
    return reader


def writer_of(task: object) -> Task:
    """Return the writer of a task; raises `HILError` where it has none."""
    task_or_pair = require(task)
    writer = task_or_pair.writer if isinstance(task_or_pair, Pair) else task_or_pair
    if writer.kind == "reader":
        raise hil_error(Code.WRITING_TO_READER)
    return writer

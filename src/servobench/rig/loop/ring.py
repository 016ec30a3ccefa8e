"""Rings in shared memory: one process writes and never waits, any number of others read, and each learns what it missed.

Rows of numbers go from the loop to the recorder and the panel, texts go both ways. `loop.kernels` says why nothing is ever torn;
compiled code may call its `push_row` and `read_rows` on a ring's `memory` itself.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from functools import cache
from types import ModuleType, TracebackType
from typing import Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.rig.loop.segment import (
    HEADER,
    SLOTS,
    WIDTH,
    WORDS,
    Memory,
    Segment,
    attach,
    create,
    integers,
)

# The words of a ring, which any process may set and get.
RECORDER_STATE = 0  # 0 none, 1 recording, 2 failed, 3 done, 4 asked to begin
RECORDER_HEARTBEAT = 1  # monotonic time [ns]
ROWS_KEPT = 2  # rows that are safe in the file
OPERATOR_HEARTBEAT = 3  # monotonic time [ns]
LOOP_STATE = 4  # 0 starting, 1 running, 2 ended
FAULT = 5  # 0 or 1
RECORD_UNTIL = 6  # the number of the first row that a late recorder leaves out; 0: none is set
CALL = 7  # what the loop's thread is doing since when: eight times the monotonic time [ns], plus a `Call`; 0: nothing to wait for
ZERO_VOLTS = 8  # 1 where the device's output is known to be zero
OPENING_TIME = 9  # how long the device may take to be opened where nothing is wrong [ns]


class Ring:
    """Base of rings: `name` to attach by, `slots` (a power of two), and `memory` for compiled code.

    The last `slots` - 1 records can be read; in the slot of the oldest one the next may be being written. Leaving its context
    closes a ring, and removes the memory where it was created; those who are still attached keep what they have.
    """

    def __init__(self, segment: Segment, *, is_owner: bool) -> None:
        self._segment = segment
        self._is_owner = is_owner
        self._memory: Memory | None = integers(segment)
        self._kernels = _kernels()
        self.name = segment.name
        self.slots = int(self._memory[SLOTS])
        self.width = int(self._memory[WIDTH])

    @property
    def memory(self) -> Memory:
        """All of the ring as integers, for compiled code; raises `UsageError` once the ring is closed."""
        if self._memory is None:
            raise UsageError(f"ring {self.name} is closed; use it within its `with`")
        return self._memory

    @property
    def written(self) -> int:
        """The number of records written so far."""
        return int(self._kernels.count_written(self.memory))

    @property
    def oldest(self) -> int:
        """The number of the oldest record that can still be read; records are numbered from 0."""
        return max(0, self.written - self.slots + 1)

    def get(self, word: int) -> int:
        """Return a word, such as `LOOP_STATE`, and see all that was written before it was set."""
        return int(self._kernels.get_word(self.memory, _check_word(word)))

    def set(self, word: int, value: int) -> None:
        """Set a word, such as `LOOP_STATE`, to a 64-bit integer."""
        self._kernels.set_word(self.memory, _check_word(word), value)

    def close(self) -> None:
        """Let go of the memory, and remove it where it was created here; may be called twice."""
        if self._memory is None:
            return
        self._memory = None
        self._segment.close()
        if self._is_owner:
            self._segment.unlink()

    def clear_up(self) -> None:
        """Remove the memory where its owner is dead; for a process that the owner started, before it ends."""
        if not self._is_owner and self._segment.is_orphan:
            self._segment.unlink()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


class RowRing(Ring):
    """A ring of rows, each of `columns` numbers. One thread of one process pushes."""

    def __init__(self, segment: Segment, *, is_owner: bool) -> None:
        super().__init__(segment, is_owner=is_owner)
        self.columns = self.width
        self._row = np.zeros(self.columns)
        self._row_bytes = self._row.data.cast("B")
        self._pack_into = struct.Struct(f"{self.columns}d").pack_into
        self._push = self._kernels.push_row

    @classmethod
    def create(cls, columns: int, slots: int = 65536) -> RowRing:
        """Make a ring of rows of `columns` numbers; raises `UsageError` for impossible sizes, `StorageError` without memory."""
        _check_sizes("columns", columns, slots)
        return cls(create("rows", slots, columns), is_owner=True)

    @classmethod
    def attach(cls, name: str) -> RowRing:
        """Attach to another process' ring; raises `UsageError` where there is none, `FormatError` where it's no ring of rows."""
        return cls(attach("rows", name), is_owner=False)

    def push(self, row: Sequence[float]) -> None:
        """Publish a row (columns,), over the oldest, and never wait; raises `UsageError` for another number of columns."""
        memory = self._memory
        if memory is None:
            memory = self.memory  # says that the ring is closed
        try:
            self._pack_into(self._row_bytes, 0, *row)
        except struct.error:
            raise UsageError(f"a row of ring {self.name} is {self.columns} numbers, not {row!r}") from None
        self._push(memory, self._row)

    def reader(self, start: int | None = None) -> RowReader:
        """Return a reader whose first row is number `start`, or the oldest that is still there."""
        return RowReader(self, _first(self, start))


class RowReader:
    """A cursor in a ring of rows: `next` is the number of the row to be read next, `missed` how many were lost so far.

    Every row before `next`, from the first on, was returned once or is counted in `missed`.
    """

    def __init__(self, ring: RowRing, start: int) -> None:
        self._ring = ring
        self.next = start
        self.missed = 0

    def read(self, most: int = 4096) -> Array:
        """Return up to `most` of the rows that there are (N, columns), none of them torn.

        None may come back where the writer overtook the reader meanwhile; `missed` has risen then.
        """
        ring = self._ring
        out = np.empty((_room(ring, self.next, most), ring.columns))
        number, begin, end = ring._kernels.read_rows(ring.memory, self.next, out)
        self.missed += number - self.next
        self.next = number + end - begin
        return out[begin:end]


class MessageRing(Ring):
    """A ring of texts of up to `size` bytes in UTF-8. One thread of one process pushes."""

    def __init__(self, segment: Segment, *, is_owner: bool) -> None:
        super().__init__(segment, is_owner=is_owner)
        # A record is the length of the text in bytes, then the text.
        self.size = 8 * (self.width - 1)
        self._record = np.zeros(self.width, np.int64)
        self._text = self._record[1:].data.cast("B")

    @classmethod
    def create(cls, slots: int = 256, size: int = 8192) -> MessageRing:
        """Make a ring of texts of `size` bytes at most, rounded up to a multiple of 8; raises as `RowRing.create`."""
        _check_sizes("size", size, slots)
        return cls(create("texts", slots, 1 + -(-size // 8)), is_owner=True)

    @classmethod
    def attach(cls, name: str) -> MessageRing:
        """Attach to another process' ring; raises `UsageError` where there is none, `FormatError` where it's no ring of texts."""
        return cls(attach("texts", name), is_owner=False)

    def push(self, text: str) -> None:
        """Publish a text; it never waits, and overwrites the oldest. Raises `UsageError` for one that is too long."""
        data = text.encode("utf-8", "surrogatepass")  # a file's name may hold what no text should
        if len(data) > self.size:
            raise UsageError(
                f"a message of {len(data)} bytes is too long for ring {self.name}, which takes {self.size}: "
                f"{text[:60]!r}...; say it in fewer words, or in two messages"
            )
        self._record[0] = len(data)
        self._text[: len(data)] = data
        self._kernels.push_row(self.memory, self._record)

    def reader(self, start: int | None = None) -> MessageReader:
        """Return a reader whose first text is number `start`, or the oldest that is still there."""
        return MessageReader(self, _first(self, start))


class MessageReader:
    """A cursor in a ring of texts: `next` is the number of the text to be read next, `missed` how many were lost so far."""

    def __init__(self, ring: MessageRing, start: int) -> None:
        self._ring = ring
        self.next = start
        self.missed = 0

    @property
    def waiting(self) -> bool:
        """Whether there is an unread text; costs much less than reading when there is none."""
        return self._ring.written != self.next

    def read(self, most: int = 256) -> list[str]:
        """Return up to `most` of the texts that there are, as they were pushed; where it was overtaken `missed` has risen."""
        ring = self._ring
        if not (room := _room(ring, self.next, most)):
            return []
        out = np.empty((room, ring.width), np.int64)
        number, begin, end = ring._kernels.read_rows(ring.memory, self.next, out)
        self.missed += number - self.next
        self.next = number + end - begin
        return [
            record[1:].tobytes()[: record[0]].decode("utf-8", "surrogatepass") for record in out[begin:end]
        ]


def load() -> None:
    """Load and compile what rings need, so that the first one is there at once."""
    _kernels()


@cache
def _kernels() -> ModuleType:
    """Return the kernels, each called once: a loop doesn't wait for the compiler at its first tick."""
    from servobench.rig.loop import kernels

    memory = np.zeros(HEADER + 2, np.int64)
    memory[SLOTS], memory[WIDTH] = 2, 1
    kernels.push_row(memory, np.zeros(1))
    kernels.push_row(memory, np.zeros(1, np.int64))
    kernels.read_rows(memory, 0, np.zeros((1, 1)))
    kernels.read_rows(memory, 0, np.zeros((1, 1), np.int64))
    kernels.set_word(memory, 0, kernels.get_word(memory, 0) + kernels.count_written(memory))
    return kernels


def _room(ring: Ring, start: int, most: int) -> int:
    """Return how many records a reader at `start` can get now, `most` at the most."""
    if most < 1:
        raise UsageError(
            f"a reader of ring {ring.name} was asked for {most} records at most; ask for 1 or more"
        )
    return max(0, min(most, ring.slots - 1, ring.written - start))


def _first(ring: Ring, start: int | None) -> int:
    """Return the number that a reader begins at."""
    if start is None:
        return ring.oldest
    if start < 0:
        raise UsageError(
            f"a reader of ring {ring.name} can't start at record {start}; records are numbered from 0"
        )
    return start


def _check_word(word: int) -> int:
    if not 0 <= word < WORDS:
        raise UsageError(f"a ring has no word {word}; it has 0 to {WORDS - 1}")
    return word


def _check_sizes(what: str, value: int, slots: int) -> None:
    """Raise `UsageError` for a ring that can't be."""
    if value < 1:
        raise UsageError(f"a ring with {what} = {value} isn't possible; expected 1 or more")
    if slots < 2 or slots & (slots - 1):
        raise UsageError(f"a ring can't have {slots} slots; expected a power of two, 2 or more")

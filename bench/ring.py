"""The ring in shared memory: what a record costs, and that nothing is torn or lost uncounted where a reader is overtaken.

A process writes rows of 8 numbers, 64 bytes, as fast as compiled code can, while this one reads and checks every number, and
sleeps now and then so that it's overtaken. The limit of the machine is the same row stored into the same slots, and nothing else.
Times are those of the processor, not of the clock on the wall.
"""

import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from figures import Figure, shown

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.rig.loop.kernels import push_row, read_rows
from servobench.rig.loop.ring import LOOP_STATE, RowReader, RowRing
from servobench.rig.loop.segment import HEADER, Memory

ROWS = 10_000_000
COLUMNS = 8
REPEATS = 20
READS_BEFORE_A_NAP = 64
NAP = 0.02  # seconds


@compiled
def pushed(memory: Memory, row: Array, first: int, rows: int) -> None:
    """Publish rows first, first + 1, ...; all numbers of row n are n."""
    for n in range(first, first + rows):
        row[:] = n
        push_row(memory, row)


@compiled
def stored(slots: Array, row: Array, first: int, rows: int) -> None:
    """Store the same rows into the same slots, and do nothing else."""
    for n in range(first, first + rows):
        row[:] = n
        for k in range(len(row)):
            slots[n & (len(slots) - 1), k] = row[k]


@compiled
def drained(memory: Memory, out: Array, first: int, rows: int) -> int:
    """Read rows as a compiled reader does, block by block, and return how many."""
    total = 0
    while total < rows:
        number, begin, end = read_rows(memory, first, out)
        if begin == end:
            return total
        first = number + end - begin
        total += end - begin
    return total


@compiled
def unlike(rows: Array, first: int) -> int:
    """Return how many rows hold anything else than their number, the first one's being `first`."""
    count = 0
    for n in range(len(rows)):
        for k in range(rows.shape[1]):
            if rows[n, k] != first + n:
                count += 1
                break
    return count


def figure(what: str, measured: Callable[[int], object], rows: int, at_most: float | None = None) -> Figure:
    """Return how long one row takes [ns] where `measured` handles that many."""
    measured(rows)  # once for the compiler and the caches
    times = []
    for _ in range(REPEATS):
        start = time.process_time_ns()
        measured(rows)
        times.append((time.process_time_ns() - start) / rows)
    low, middle, high = statistics.quantiles(times, n=4)
    return Figure(what=what, value=middle, half=(low, high), unit="ns", at_most=at_most)


def alone(rows: int) -> list[Figure]:
    """Return what a row costs in one process, where nobody else uses the ring."""
    with RowRing.create(COLUMNS) as ring:
        row, memory = np.zeros(COLUMNS), ring.memory
        slots = memory[HEADER : HEADER + ring.slots * COLUMNS].view(float).reshape(ring.slots, COLUMNS)
        numbers = [float(k) for k in range(COLUMNS)]

        def from_python(count: int) -> None:
            for _ in range(count):
                ring.push(numbers)

        def read(_rows: int) -> None:
            reader = ring.reader()
            while reader.next < ring.written:
                reader.read()

        out = np.empty((4096, COLUMNS))
        return [
            figure("row stored, compiled: the machine's limit", lambda n: stored(slots, row, 0, n), rows),
            figure("row pushed, compiled", lambda n: pushed(memory, row, 0, n), rows, at_most=100.0),
            figure("row pushed from Python", from_python, max(1, rows // 20)),
            figure(
                "row read, compiled, in blocks of 4096",
                lambda n: drained(memory, out, ring.oldest, n),
                min(ring.written, ring.slots - 1),
            ),
            figure("row read from Python, in blocks of 4096", read, min(ring.written, ring.slots - 1)),
        ]


def between(rows: int) -> list[Figure]:
    """Return what comes of rows written by another process while a reader checks them and is overtaken."""
    with RowRing.create(COLUMNS) as ring:
        reader = ring.reader()
        command = [sys.executable, str(Path(__file__).resolve()), ring.name, str(rows)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            try:
                unlike(reader.read(), 0)  # compiled before it counts
                ring.set(LOOP_STATE, 1)
                received, torn = check(ring, reader, writer)
                said, _ = writer.communicate()
            finally:
                writer.kill()
        lost = rows - received - reader.missed
        return [
            Figure(
                what=f"row pushed, compiled, {rows:g} rows, with a reader",
                value=float(said),
                unit="ns",
                at_most=100.0,
            ),
            Figure(
                what="rows that the overtaken reader missed, counted",
                value=reader.missed / rows,
                unit="of all",
            ),
            Figure(what="rows lost and not counted", value=abs(lost), at_most=0.0),
            Figure(what="rows torn", value=torn, at_most=0.0),
        ]


def check(ring: RowRing, reader: RowReader, writer: "subprocess.Popen[str]") -> tuple[int, int]:
    """Read until the writer has ended, and return how many rows came and how many of them were torn."""
    received = torn = reads = 0
    while (ring.get(LOOP_STATE) != 2 and writer.poll() is None) or reader.next < ring.written:
        rows = reader.read()
        torn += unlike(rows, reader.next - len(rows))
        received += len(rows)
        reads += len(rows) > 0
        if reads % READS_BEFORE_A_NAP == 1:
            reads += 1
            time.sleep(NAP)
    return received, torn


def write(name: str, rows: int) -> None:
    """Be the writing process: wait for the reader, write, and print what a row took [ns]."""
    with RowRing.attach(name) as ring:
        row = np.zeros(ring.columns)
        pushed(ring.memory, row, 0, 0)  # compiled before it counts
        while ring.get(LOOP_STATE) == 0:
            time.sleep(0.001)
        start = time.process_time_ns()
        pushed(ring.memory, row, 0, rows)
        took = time.process_time_ns() - start
        ring.set(LOOP_STATE, 2)
    print(took / rows)


def main(rows: int = ROWS) -> list[Figure]:
    """Return the figures of this bench."""
    return [*alone(rows // REPEATS), *between(rows)]


def smallest() -> list[Figure]:
    """Return the figures of few rows."""
    return main(20_000)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        write(sys.argv[1], int(sys.argv[2]))
    else:
        sys.exit(shown(main()))

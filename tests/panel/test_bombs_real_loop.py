"""Uploads that are made to hurt, while the real loop goes on: what they could do to a tick, by the system's own account.

A tick is missed where the loop waits for something else than its deadline, or where it can't have the processor. So the loop's
waits are counted: one for each tick, whatever comes in. And whoever unpacks a bomb is looked at: it has nothing of
the loop's memory, comes after it at the processor, and takes little memory. How many ticks are missed meanwhile on a busy
machine says nothing about the bombs, and isn't asked.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from threading import Event, Thread
from typing import Any, Self

import httpx
import pytest

from servobench.rig.loop.ring import LOOP_STATE, RowRing
from servobench.rig.loop.spec import COLUMNS as WIDE
from servobench.rig.loop.spec import RUNNING
from tests.panel.test_bodies import bombs
from tests.panel.test_real_loop import PATIENCE, Program, played, program
from tests.processes import children, most_memory

__all__ = ["program"]

# Of the ticks. Whoever waited for the server would wait at its thirty looks a second, at 6 of 100 ticks of 2 ms. The system's own
# waits, as for a page of memory that it moves, are 1 in 1000, with and without bombs.
MOST_WAITS = 0.01
MOST_MEMORY = 64 * 2**20  # bytes that a bomb may cost
GOOD = b"t,u,y\n" + b"".join(b"%.3f,%d,%.4f\n" % (0.001 * k, k // 500 % 2, 0.01 * k) for k in range(2000))
ORDINARY = 0  # SCHED_OTHER


@dataclass
class Worker:
    """Observations of the process that reads an upload."""

    largest: int = 0  # bytes
    niceness: int = 0
    policy: int = -1
    rings: set[str] = field(default_factory=set)

    def look(self, pid: int) -> None:
        """Take note of it as it is now; one that has ended meanwhile is what it was."""
        with suppress(OSError, IndexError):
            process = Path(f"/proc/{pid}")
            fields = (process / "stat").read_text().rpartition(")")[2].split()
            self.rings |= {
                line for line in (process / "maps").read_text().splitlines() if "/servobench-" in line
            }
            self.largest = max(self.largest, most_memory(pid))
            self.niceness, self.policy = max(self.niceness, int(fields[16])), int(fields[38])


@contextmanager
def rows_of(server: int) -> Iterator[RowRing]:
    """The ring between a server and its loop."""
    with ExitStack() as stack:
        found = Path("/dev/shm").glob(f"servobench-rows-{server}-*")
        rings = [stack.enter_context(RowRing.attach(path.name)) for path in found]
        (ring,) = (ring for ring in rings if ring.columns == WIDE)
        yield ring


def waits(loop: int) -> int:
    """The number of times that the loop's thread has released the processor by itself so far."""
    status = Path(f"/proc/{loop}/task/{loop}/status").read_text()
    return int(status.split("\nvoluntary_ctxt_switches:")[1].split()[0])


class Uploads:
    """A client that uploads files as a page does, and observes the process that reads each."""

    def __init__(self, program: Program) -> None:
        self._server = program.process.pid
        self._client = httpx.Client(base_url=program.base, timeout=3 * PATIENCE)
        self._client.get(f"/?token={program.key}")
        told = self._client.get("/api/session", headers={"sec-fetch-site": "same-origin"}).json()
        self._headers = {
            "origin": program.base,
            "sec-fetch-site": "same-origin",
            "content-type": "application/octet-stream",
            "x-servobench-token": told["token"],
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def __call__(self, name: str, content: bytes) -> tuple[int, Worker]:
        """Upload a file; return the answer's status, and what was seen."""
        worker, over = Worker(), Event()

        def look() -> None:
            while not over.wait(0.01):
                for pid in children(self._server, "servobench.panel.work"):
                    worker.look(pid)

        looking = Thread(target=look)
        looking.start()
        try:
            answer = self._client.post(f"/api/upload?name={name}", headers=self._headers, content=content)
        finally:
            over.set()
            looking.join()
        return answer.status_code, worker


@pytest.mark.skipif(not Path("/proc/self/status").is_file(), reason="Linux tells what processes do")
def test_bombs_make_the_loop_wait_for_nothing_and_take_little_memory(program: Program) -> None:
    bad = bombs()
    server = program.process.pid

    async def opened(sockets: list[Any]) -> None:
        await program.page(sockets)  # which waits until the loop goes on

    played(opened)
    with Uploads(program) as upload, rows_of(server) as ring:
        status, usual = upload("good.csv", GOOD)
        assert status == 200
        (loop,) = children(server, "servobench.rig.loop.child")
        before = most_memory(server)
        # In this order a row that comes between two looks is never on the wrong side.
        rows_before, waits_before = ring.written, waits(loop)
        for name, content in bad.items():
            status, worker = upload(name, content)
            assert status in (400, 413), name
            check_harmless(name, worker, usual)
        waits_after, rows_after = waits(loop), ring.written
        assert ring.get(LOOP_STATE) == RUNNING

    ticks = rows_after - rows_before
    assert ticks > 0
    assert waits_after - waits_before - ticks <= 2 + MOST_WAITS * ticks  # 2: those under way at both looks
    assert most_memory(server) - before <= MOST_MEMORY
    assert children(server, "servobench.rig.loop.child") == [loop]


def check_harmless(name: str, worker: Worker, usual: Worker) -> None:
    """A bomb's reader comes after the loop, has none of its memory, and takes hardly more than that of a small file."""
    assert worker.policy in (ORDINARY, -1), name  # -1: refused before anybody had to read it
    if worker.policy == ORDINARY:
        # Ten more than the program that started it, which has that of these tests.
        assert worker.niceness == min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10), name
        assert worker.rings == set(), name
        assert worker.largest - usual.largest <= MOST_MEMORY, name

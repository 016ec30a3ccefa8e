"""An application that records, to be killed at any point: a loop and its recorder in one process, in virtual time.

`python -m tests.faults.killed` gets a line `PATH ROWS EVENTS` for each of them and forks it off, so that all that takes long to
begin, imports and compiled code, is there already. It answers with the process' number, and once that is dead with its status.
"""

import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from servobench.rig.loop.recording_process import INTERVAL, record
from servobench.rig.loop.ring import MessageRing, RowRing
from tests.rig.loop.rings import RingLoop

SAMPLE_TIME = 0.001  # s
TICKS_A_LOOK = round(INTERVAL / SAMPLE_TIME)


def run(path: Path, rows: str, events: str) -> None:
    """Record for ever, into rings of that name, which outlive this process."""
    with (
        RowRing.attach(rows) as row_ring,
        MessageRing.attach(events) as event_ring,
        RingLoop(
            path,
            ticks=10**9,
            ticks_a_look=TICKS_A_LOOK,
            sample_time=SAMPLE_TIME,
            rings=(row_ring, event_ring),
        ) as loop,
    ):
        loop.open()
        record(loop.spec, loop.rows, loop.events, loop)


def main() -> None:
    with TemporaryDirectory() as folder, RingLoop(Path(folder) / "a.mcap") as loop:
        loop.open()
        record(loop.spec, loop.rows, loop.events, loop)  # so that everything is loaded
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            path, rows, events = line.split()
            run(Path(path), rows, events)
        print(child, flush=True)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


if __name__ == "__main__":
    main()

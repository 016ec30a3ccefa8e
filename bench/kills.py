"""The loss of a recording by kill -9: runs at 500 Hz, all of whose processes are killed at a random moment.

    python bench/kills.py --count 100

The ring in shared memory outlives them, and tells how many samples there were; what is recovered from the disk is compared with
that. The recorder looks every 30 ms, which is 15 samples.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from figures import Figure, shown

COUNT, SAMPLE_TIME, SEED = 100, 0.002, 18  # runs, s
SPAN = (0.2, 2.0)  # s after the first samples are on the disk
FIRST = 20  # samples
MOST = 17  # samples that a kill may cost: a look of the recorder, and what came while it wrote
PROGRAM = """
import sys, time
from servobench.rig.experiment import DeviceChoice, Experiment
from servobench.rig.loop.process import LoopProcess
twin = DeviceChoice(name="twin", settings={"timing": "host"})
with LoopProcess(Experiment(duration=None, sample_time=float(sys.argv[2]), device=twin), record=sys.argv[1]) as loop:
    print(loop.pid, loop._recording[0].pid, loop.ring.name, flush=True)
    time.sleep(600)
"""


def main(count: int = COUNT) -> list[Figure]:
    """Return the samples that were lost, of some runs that were killed (six minutes)."""
    lost = sorted(losses(count))
    quartiles = (float(lost[len(lost) // 4]), float(lost[(3 * len(lost)) // 4]))
    middle = float(lost[len(lost) // 2])
    return [
        Figure(what=f"samples lost by kill -9, of {count}: median", value=middle, half=quartiles),
        Figure(what=f"samples lost by kill -9, of {count}: most", value=float(lost[-1]), at_most=MOST),
    ]


def smallest() -> list[Figure]:
    """Return the same of a single run."""
    return main(1)


def losses(count: int) -> Iterator[int]:
    """Give the number of samples that each killed run lost."""
    moments = random.Random(SEED)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(count):
            yield lost(Path(folder) / f"{number}.mcap", moments.uniform(*SPAN))


def lost(path: Path, after: float) -> int:
    """Kill a run so long after its first samples were kept [s], recover it, and return how many samples are missing."""
    from servobench.recordings.native.recover import recover
    from servobench.rig.loop.ring import ROWS_KEPT, RowRing

    program = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(path), str(SAMPLE_TIME)], stdout=subprocess.PIPE, text=True
    )
    assert program.stdout is not None
    loop, recorder, name = program.stdout.readline().split()
    with RowRing.attach(name) as rows:
        while rows.get(ROWS_KEPT) < FIRST and program.poll() is None:
            time.sleep(SAMPLE_TIME)
        time.sleep(after)
        for process in (int(recorder), int(loop), program.pid):
            os.kill(process, signal.SIGKILL)
        program.communicate()
        written = rows.written
    (found,) = recover(path.with_name(path.name + ".part"), path.with_name("whole-" + path.name))
    return written - len(found["scheduled"].values)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=COUNT, help="how many runs")
    sys.exit(shown(main(parser.parse_args().count)))

"""Row 18: the whole application is killed while it records. What was recorded until shortly before can be recovered, always."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import NonSeekingReader

from servobench.recordings.native.recover import recover
from servobench.rig.loop.ring import ROWS_KEPT, RowRing
from tests.faults.killed import SAMPLE_TIME, TICKS_A_LOOK
from tests.rig.loop.rings import RingLoop, ticks_of

OLD = 0.25  # s
KILLS = 100
"""Random moments, as the safety page says; in `make test` a quarter of them."""
SHARE = 0.99  # of the samples that are older
LONGEST = 60.0  # seconds; a hang would take for ever
POLL = 2e-4  # seconds; looking without a break takes the processor from the application that is looked at


class Applications:
    """The server that forks the applications that are killed."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.faults.killed"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )

    def start(self, path: Path, loop: RingLoop) -> int:
        """Start an application that writes to the rings of a loop; return its process' number."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{path} {loop.rows.name} {loop.events.name}\n")
        self._process.stdin.flush()
        return self.status()

    def status(self) -> int:
        """Return the next number that the server says."""
        assert self._process.stdout is not None
        return int(self._process.stdout.readline())

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def end(self) -> None:
        self._process.communicate(timeout=LONGEST)


@pytest.fixture
def applications() -> Iterator[Applications]:
    server = Applications()
    yield server
    server.end()


@pytest.mark.promise("S25")
@pytest.mark.parametrize("kills", [25, pytest.param(KILLS, marks=pytest.mark.long)])
def test_of_killed_applications_all_that_is_older_than_250_ms_is_recovered(
    tmp_path: Path, applications: Applications, kills: int
) -> None:
    random = np.random.default_rng(18)
    shares = []
    for k in range(kills):
        path = tmp_path / f"{k}.mcap"
        # The rings are this process' own, so that they tell how far the killed one had come.
        with RingLoop(path, sample_time=SAMPLE_TIME) as ours:
            kill_at = int(random.integers(300, 3000))
            child = applications.start(path, ours)
            while ours.rows.written < kill_at and applications.running:
                time.sleep(POLL)
            os.kill(child, signal.SIGKILL)
            assert applications.status() == -signal.SIGKILL
            pushed = ours.rows.written

        whole = tmp_path / f"{k}-recovered.mcap"
        (found,) = recover(tmp_path / f"{k}.mcap.part", whole)

        ticks = ticks_of(found, SAMPLE_TIME)
        assert ticks.tolist() == list(range(len(ticks)))
        older = pushed - round(OLD / SAMPLE_TIME)
        shares.append(min(1.0, len(ticks) / older))
        assert kill_at <= pushed
        # What wasn't written yet is what came since the last look, as the recorder looks each 30 ms.
        assert pushed - len(ticks) <= 2 * TICKS_A_LOOK
        with whole.open("rb") as file:
            assert sum(1 for _ in NonSeekingReader(file, validate_crcs=True).iter_messages()) == len(ticks)

    assert len(shares) == kills
    assert min(shares) >= SHARE


PROGRAM = """
import sys, time
from servobench.rig.experiment import DeviceChoice, Experiment
from servobench.rig.loop.process import LoopProcess
twin = DeviceChoice(name="twin", settings={"timing": "host"})
with LoopProcess(Experiment(duration=None, sample_time=0.002, device=twin), record=sys.argv[1]) as loop:
    print(loop.pid, loop._recording[0].pid, loop.ring.name, flush=True)
    time.sleep(600)
"""


@pytest.mark.promise("S25")
def test_a_real_run_of_which_all_three_processes_are_killed_leaves_all_that_was_said_to_be_kept(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.mcap"
    program = subprocess.Popen([sys.executable, "-c", PROGRAM, str(path)], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    loop, recorder, name = program.stdout.readline().split()
    with RowRing.attach(name) as rows:
        while rows.get(ROWS_KEPT) < 200 and program.poll() is None:
            time.sleep(POLL)
        for process in (int(recorder), int(loop), program.pid):
            os.kill(process, signal.SIGKILL)
        program.wait(LONGEST)
        program.stdout.close()
        kept = rows.get(ROWS_KEPT)

    (found,) = recover(tmp_path / "a.mcap.part", tmp_path / "b.mcap")

    ticks = np.rint(found["scheduled"].values / 0.002).astype(int)
    assert len(ticks) == len(np.unique(ticks)) >= kept >= 200

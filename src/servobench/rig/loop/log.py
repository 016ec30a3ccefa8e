"""The log of a run in the program's own process: rows in blocks to a recorder, with an account of their timing."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding
from servobench.recordings.recording import Recording, Stopped
from servobench.rig.clock import Tick
from servobench.rig.loop.account import Account
from servobench.rig.loop.blocks.block_pass import BLOCK_ROWS
from servobench.rig.loop.opening import RowMaker
from servobench.rig.loop.place import Place
from servobench.rig.loop.recorder import InMemory, Recorder

BLOCK_TIME = 0.5  # s; what a crash of the process may cost


def block_of(sample_time: float) -> int:
    """Return how many rows go to a recorder at once, by the sample time [s]."""
    return max(1, min(BLOCK_ROWS, int(BLOCK_TIME / sample_time)))


class Log:
    """Gathers the ticks of a run in blocks of `block` for the recorder, and has them counted by the account.

    `kept` keeps them for a `look` during the run.
    """

    def __init__(
        self, recorder: Recorder, row: RowMaker, account: Account, block: int, memory: InMemory | None = None
    ) -> None:
        self._recorder = recorder
        self._row = row
        self._kept = memory
        self._block = block
        self._rows: list[tuple[float, ...]] = []
        self._blocks: list[Array] = []
        self._waiting = self._passed_on = 0  # rows in the blocks, and those that the recorder has
        self._account = account

    def add(self, place: Place) -> None:
        """Take one tick that is done."""
        self._rows.append(self._row(place))
        self._account.add(place.tick)
        if len(self._rows) >= self._block:
            self._flush()

    def add_block(self, rows: Array, last: Tick) -> None:
        """Take the rows (N, 1 + C) of ticks that are done, in time, up to the last one."""
        if self._rows:
            self._keep_rows()
        self._blocks.append(rows)
        self._waiting += len(rows)
        self._account.add_block(len(rows), last)
        if self._waiting >= self._most:
            self._flush()

    def complete(self, ticks: int | None) -> None:
        """Take note that all ticks of the run have gone by: those after the last one that was done were missed."""
        self._account.complete(ticks)

    def so_far(self) -> Recording:
        """Pass on the remaining rows, and return the recording so far; raises `UsageError` if the log doesn't keep it."""
        if self._kept is None:
            raise UsageError("this run keeps no recording to look at: give `look`")
        self._flush()
        return self._kept.end(Stopped(reason="unknown", sentence="the run goes on"), self._account.findings())

    def end(self, stopped: Stopped, findings: tuple[Finding, ...] = ()) -> Recording:
        """Pass on the remaining rows, and return the recording with its findings."""
        self._flush()
        return self._recorder.end(stopped, (*self._account.findings(), *findings))

    @property
    def _most(self) -> int:
        """The number of rows that go to the recorder at once: if the disk is full, no more than these are lost."""
        return min(max(self._block, self._passed_on), BLOCK_ROWS)

    def _keep_rows(self) -> None:
        # Away with the rows first: an interruption in the middle may lose a block at the end, but never doubles one.
        rows, self._rows = self._rows, []
        self._blocks.append(np.array(rows, dtype=np.float64))

    def _flush(self) -> None:
        if self._rows:
            self._keep_rows()
        blocks, self._blocks, self._waiting = self._blocks, [], 0
        if not blocks:
            return
        rows = blocks[0] if len(blocks) == 1 else np.concatenate(blocks)
        while len(rows):
            most = self._most
            block, rows = rows[:most], rows[most:]
            self._recorder.append(block)
            self._passed_on += len(block)
            if self._kept is not None:
                self._kept.append(block)

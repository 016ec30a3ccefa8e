"""Doing the runs that aren't kept yet, in several processes, with word of how long it will take."""

import multiprocessing
import signal
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from accuracy_parts.rows import Row
from accuracy_parts.runs import Run, one_run
from accuracy_parts.storage import keep, kept

_BATCH = 5  # runs that a process does at once
_SAVE = 10.0  # seconds between two writings


@dataclass
class Clock:
    """The progress of the bench: runs done and to do, and the time of its start."""

    todo: int
    done: int = 0
    begun: float = field(default_factory=time.monotonic)

    def told(self, row: Row, have: int, want: int) -> None:
        """Tell on standard error how far it is."""
        took = time.monotonic() - self.begun
        left = took / self.done * (self.todo - self.done) if self.done else float("nan")
        line = f"{row.name}: {have}/{want} runs, {self.done}/{self.todo} in all, {_words(left)} left"
        if sys.stderr.isatty():
            print(f"\r{line:100}", end="\n" if have >= want else "", file=sys.stderr, flush=True)
        elif have >= want:
            print(line, file=sys.stderr, flush=True)


def done(rows: Sequence[Row], runs: int, jobs: int, folder: Path, codes: Mapping[str, str]) -> None:
    """Do the first `runs` runs of each row that aren't kept, and keep them; `codes` are the rows' fingerprints by name."""
    have = {row.name: kept(folder, row, codes[row.name]) for row in rows}
    missing = {row.name: sorted(set(range(runs)) - {run["run"] for run in have[row.name]}) for row in rows}
    clock = Clock(todo=sum(map(len, missing.values())))
    if not clock.todo:
        return
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=spawn, initializer=_leave_interrupts_to_the_parent) as pool:
        for row in rows:
            if missing[row.name]:
                results = pool.map(_batch, _batches(row, missing[row.name]))
                _one_row(row, have[row.name], runs, results, clock, folder, codes[row.name])


def _leave_interrupts_to_the_parent() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _batches(row: Row, missing: list[int]) -> list[tuple[Row, list[int]]]:
    return [(row, missing[n : n + _BATCH]) for n in range(0, len(missing), _BATCH)]


def _one_row(
    row: Row, have: list[Run], want: int, results: Iterator[list[Run]], clock: Clock, folder: Path, code: str
) -> None:
    """Keep the results of a row as they come, also where they end before their time."""
    saved = time.monotonic()
    try:
        for batch in results:
            have += batch
            clock.done += len(batch)
            clock.told(row, len(have), want)
            if time.monotonic() - saved > _SAVE:
                keep(folder, row, code, have)
                saved = time.monotonic()
    finally:
        keep(folder, row, code, have)


def _batch(work: tuple[Row, list[int]]) -> list[Run]:
    row, numbers = work
    return [one_run(row, number) for number in numbers]


def _words(seconds: float) -> str:
    if seconds != seconds:
        return "unknown time"
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"

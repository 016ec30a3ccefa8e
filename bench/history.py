"""What speeds were: times over that of a fixed workload in the same run, in bench/history.csv, so that a slow-down shows.

The workload is what an estimator does without being one: many small NumPy calls, a few large ones, products of tall matrices. It
never changes, so that a ratio from another machine, or from a busy one, can be compared, which a time can't. An entry is
appended by `python bench/cost.py --keep`, where a change is meant to alter a speed.
"""

import csv
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from figures import Figure

FILE = Path(__file__).resolve().parent / "history.csv"
COLUMNS = ("date", "version", "commit", "what", "ratio", "milliseconds")
TWICE = 2.0
_TALL = np.sin(np.arange(30_000.0)).reshape(5000, 6)
_SMALL = np.eye(6) + 0.1 * _TALL[:6]


@dataclass(frozen=True, kw_only=True)
class Timing:
    """The processor times of a call [ms], each with that of the workload just before it."""

    times: tuple[float, ...]
    references: tuple[float, ...]

    @property
    def ratio(self) -> float:
        """The median of the ratios within the pairs."""
        return statistics.median(t / r for t, r in zip(self.times, self.references, strict=True))

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """The quartiles of the times [ms]."""
        low, middle, high = statistics.quantiles(self.times, n=4)
        return low, middle, high


def milliseconds(call: Callable[[], object]) -> float:
    """Return the processor time that a call takes [ms]."""
    start = time.process_time()
    call()
    return 1e3 * (time.process_time() - start)


def timed(call: Callable[[], object], times: int) -> Timing:
    """Return how long a call takes beside the workload, in turns, the first one left out."""
    call()
    workload()
    pairs = [(milliseconds(workload), milliseconds(call)) for _ in range(times)]
    return Timing(times=tuple(t for _, t in pairs), references=tuple(r for r, _ in pairs))


def workload() -> None:
    """Do what never changes, about 1 ms of it."""
    for _ in range(5):
        total = _TALL.T @ _TALL
        np.cumsum(np.exp(-np.abs(_TALL[:, 0])))
        np.median(_TALL[:, 1])
        for _ in range(12):
            scale = 1.0 / np.sqrt(np.diag(total))
            np.linalg.solve(_SMALL, scale * total[0])
            np.flatnonzero(np.minimum(np.maximum(scale, 0.0), 1.0) > 0.5)


def last_entries(file: Path = FILE) -> dict[str, dict[str, str]]:
    """Return the last entry of each thing that was timed, by its name."""
    with file.open(encoding="utf-8", newline="") as rows:
        return {row["what"]: row for row in csv.DictReader(rows)}


def against_history(timings: Mapping[str, Timing], file: Path = FILE) -> list[Figure]:
    """Return how many times as long each thing takes as at its last entry; twice as long is too long."""
    entries = last_entries(file)
    return [
        Figure(
            what=f"{what}: over that of {entries[what]['date']}",
            value=timing.ratio / float(entries[what]["ratio"]),
            unit="times",
            at_most=TWICE,
        )
        for what, timing in timings.items()
        if what in entries
    ]


def keep(timings: Mapping[str, Timing], file: Path = FILE) -> None:
    """Append an entry for each thing that was timed."""
    from servobench import __version__

    new = not file.exists()
    with file.open("a", encoding="utf-8", newline="") as out:
        rows = csv.writer(out, lineterminator="\n")
        if new:
            rows.writerow(COLUMNS)
        for what, timing in timings.items():
            ratio, middle = f"{timing.ratio:.3g}", f"{timing.quartiles[1]:.3g}"
            rows.writerow([datetime.now(UTC).date(), __version__, _commit(), what, ratio, middle])


def _commit() -> str:
    """The commit of the checkout, empty where there is none."""
    asked = ["git", "-C", str(FILE.parent), "rev-parse", "--short", "HEAD"]
    try:
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""

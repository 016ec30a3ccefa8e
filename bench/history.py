"""The history of speeds: times over that of a fixed workload in the same run, in bench/history.csv, so that a slow-down shows.

The workload never changes, so that a ratio from another machine, or from a busy one, can be compared, which a time can't. For
a fit it is what an estimator does without being one: many small NumPy calls, a few large ones, products of tall matrices. For a
run it is the same motor in C. An entry is appended by `python bench/cost.py --keep` and `python bench/speed.py --write`, where a
change is meant to alter a speed.

Noise is kept out in three ways. A ratio is formed within each pair of calls, one right after the other, so that a load meets
both. The median of the pairs counts, against the median of the last five entries. What seems to be twice as slow is measured
again, and is said to be so only if it is both times.
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
ENTRIES = 5  # whose median counts
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


def timed(call: Callable[[], object], times: int, reference: Callable[[], object] | None = None) -> Timing:
    """Return how long a call takes beside a reference, the workload by default, in turns, the first one left out."""
    reference = reference or workload
    call()
    reference()
    pairs = [(milliseconds(reference), milliseconds(call)) for _ in range(times)]
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


def past_ratios(file: Path = FILE) -> dict[str, list[float]]:
    """Return the last ratios of each thing that was timed, by its name, oldest first."""
    found: dict[str, list[float]] = {}
    with file.open(encoding="utf-8", newline="") as rows:
        for row in csv.DictReader(rows):
            found.setdefault(row["what"], []).append(float(row["ratio"]))
    return {what: ratios[-ENTRIES:] for what, ratios in found.items()}


def against_history(timings: Mapping[str, Timing], file: Path = FILE) -> list[Figure]:
    """Return how many times as long each thing takes as it did, by the median of its entries; twice as long is too long."""
    entries = past_ratios(file)
    return [
        Figure(
            what=f"{what}: over the median of its last {len(entries[what])} entries",
            value=timing.ratio / statistics.median(entries[what]),
            unit="times",
            at_most=TWICE,
        )
        for what, timing in timings.items()
        if what in entries
    ]


def slower_twice(measure: Mapping[str, Callable[[], Timing]], file: Path = FILE) -> list[Figure]:
    """Return what takes twice as long as it did, by two measurements of each, one after the other."""
    found = []
    for what, once in measure.items():
        figures = against_history({what: once()}, file)
        if not all(each.is_kept for each in figures):
            figures = against_history({what: once()}, file)
        found += [each for each in figures if not each.is_kept]
    return found


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

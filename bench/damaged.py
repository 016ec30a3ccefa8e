"""Whether damaged recordings are told from sound ones, and by the right name: docs/benchmarks/damaged.md.

    python bench/damaged.py                 all damages, 10 seeds each
    python bench/damaged.py --seeds 3

Every damage is done to recordings of ours, mild and severe. A hit is a finding with one of the codes that are right for it.
A false alarm is any warning or refusal about a recording that isn't damaged.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

from damaged_parts.runs import Run
from figures import Figure

OUT = Path(__file__).resolve().parent.parent / "docs" / "benchmarks"


def main() -> list[Figure]:
    """Return hits and false alarms of one seed, for `make bench`."""
    from damaged_parts.runs import damaged_runs, undamaged_runs

    return figures(damaged_runs((1,)), undamaged_runs((1,)))


def smallest() -> list[Figure]:
    """Return the figures of the first damage and of the first sound recording alone."""
    from damaged_parts.damages import copies
    from damaged_parts.recordings import undamaged
    from damaged_parts.runs import damaged_run, undamaged_run

    return figures([damaged_run(next(iter(copies())), 1)], [undamaged_run(next(iter(undamaged())), 1)])


def figures(damaged: Sequence[Run], sound: Sequence[Run]) -> list[Figure]:
    """Return how many damages were found, and how many alarms were false."""
    return [
        Figure(
            what=f"damaged recordings that are told by the right name, of {len(damaged)}",
            value=float(sum(run.hit for run in damaged)),
            at_least=float(len(damaged)),
        ),
        Figure(
            what=f"false alarms in {len(sound)} sound recordings",
            value=float(sum(bool(run.grave) for run in sound)),
            at_most=0.0,
        ),
    ]


def command(words: Sequence[str]) -> int:
    """Run all damages and write the table; returns the exit status."""
    from damaged_parts import page
    from damaged_parts.runs import damaged_runs, undamaged_runs

    parser = argparse.ArgumentParser(description="Damaged recordings: hits and false alarms.")
    parser.add_argument("--seeds", type=int, default=10, help="seeds of each damage (%(default)s)")
    parser.add_argument("--out", type=Path, default=OUT, help="where the table goes (%(default)s)")
    asked = parser.parse_args(words)
    seeds = range(1, asked.seeds + 1)
    page.write(damaged_runs(seeds), undamaged_runs(seeds), asked.out)
    return 0


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))

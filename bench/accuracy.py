"""The accuracy of the estimates relative to the bound, the coverage of the intervals and the verdicts: Monte Carlo.

    python bench/accuracy.py                              all rows, 1000 runs each; hours
    python bench/accuracy.py --runs 100 --rows encoder "torque*" --jobs 2
    python bench/accuracy.py --list

Each run's result is kept below `build/accuracy`, so that a bench that was
interrupted goes on, and more runs extend what there is. Runs of other code aren't used.
The table goes to docs/benchmarks/accuracy.md, the figures to accuracy.json beside it.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

# Before NumPy is there: two processes with two threads each would be in each other's way.
os.environ.setdefault("OMP_NUM_THREADS", "1")

from figures import Figure

if TYPE_CHECKING:
    from accuracy_parts.rows import Row

ROOT = Path(__file__).resolve().parent.parent
WORK = ROOT / "build" / "accuracy"
OUT = ROOT / "docs" / "benchmarks"
_QUICK_ROWS = ("encoder", "torque_1e-5", "coulomb_delay_0.3")
_QUICK_RUNS = 20


def main(names: Sequence[str] = _QUICK_ROWS, runs: int = _QUICK_RUNS) -> list[Figure]:
    """Return a quick look at a few rows, for `make bench`: no more than whether anything is badly wrong.

    The limit is what 20 runs of an estimator at 1.05 times the bound exceed once in a million: the square of their RMSE is
    χ² with 20 degrees of freedom. The figures that are promised are those of the whole table.
    """
    from accuracy_parts.rows import rows
    from accuracy_parts.runs import one_run
    from accuracy_parts.summary import summarised
    from scipy.stats import chi2

    limit = 1.05 * float((chi2.isf(1e-6, runs) / runs) ** 0.5)
    figures = []
    for row in (row for row in rows() if row.name in names):
        found = summarised([one_run(row, number) for number in range(runs)])
        for name, a in found.accuracy.items():
            what = f"{row.words}: RMSE of the {name.replace('_', ' ')}, {runs} runs"
            value = float("nan") if a.rmse is None or found.failed else a.rmse
            figures.append(
                Figure(what=what, value=value, unit="bounds", at_most=limit, goal="1.05 in 1000 runs")
            )
    return figures


def smallest() -> list[Figure]:
    """Return the figures of two runs of one row."""
    return main(_QUICK_ROWS[:1], 2)


def chosen_rows(names: Sequence[str]) -> list[Row]:
    """Return the rows of those names, all without any; a name that ends in * stands for all that begin so."""
    from accuracy_parts.rows import rows

    known = {row.name: row for row in rows()}
    found: list[str] = []
    for name in names or known:
        meant = [k for k in known if k == name or (name.endswith("*") and k.startswith(name[:-1]))]
        if not meant:
            raise SystemExit(f"no row called {name}; --list shows all")
        found += [k for k in meant if k not in found]
    return [known[name] for name in found]


def command(words: Sequence[str]) -> int:
    """Run rows and write the table; returns the exit status."""
    parser = argparse.ArgumentParser(description="Accuracy, coverage and verdicts by Monte Carlo.")
    parser.add_argument("--runs", type=int, default=1000, help="runs of each row (%(default)s)")
    parser.add_argument(
        "--rows",
        nargs="+",
        default=[],
        metavar="NAME",
        help="rows to run (all); torque* is all that begin so",
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes (%(default)s)")
    parser.add_argument("--work", type=Path, default=WORK, help="where runs are kept (%(default)s)")
    parser.add_argument("--out", type=Path, default=OUT, help="where the table goes (%(default)s)")
    parser.add_argument("--list", action="store_true", help="list the rows")
    asked = parser.parse_args(words)

    rows = chosen_rows(asked.rows)
    if asked.list:
        print("\n".join(f"{row.name:28} {row.words}" for row in rows))
        return 0
    return _run(rows, asked.runs, asked.jobs, asked.work, asked.out)


def _run(rows: Sequence[Row], runs: int, jobs: int, work: Path, out: Path) -> int:
    """Run rows, then write the table of all rows that there are runs of. The code is examined once, at the beginning."""
    from accuracy_parts import page
    from accuracy_parts.storage import fingerprint
    from accuracy_parts.work import done

    every = chosen_rows([])
    codes = {row.name: fingerprint(row) for row in every}
    try:
        done(rows, runs, jobs, work, codes)
        return 0
    except KeyboardInterrupt:
        print("\ninterrupted; the same command goes on from here", file=sys.stderr)
        return 130
    finally:
        page.write(every, work, out, codes)


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))

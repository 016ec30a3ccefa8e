"""Whether answers are right on random motors over the whole range that people own: verdicts, intervals, causes, cost.

    python bench/population.py --count 1000                       1000 random motors; half an hour
    python bench/population.py --from 300 --count 100             motors 300 to 399
    python bench/population.py --model-error play --count 50      motors that depart a little from the model; `all` for each kind
    python bench/population.py --from-table population.json       judge again what is kept in a table

Motor n is drawn from a seed of its own, so that any slice comes out the same. The truth comes from a simulator and a bound of
the bench's own (`population_parts`).
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

os.environ.setdefault("OMP_NUM_THREADS", "1")

from figures import Figure, shown

if TYPE_CHECKING:
    from population_parts.judge import Row

COUNT = 1000
FEW = 60
DEPARTED = 50
_VERDICTS = ("trusted", "doubtful", "refused")
_BOUNDS = {"bound": "bound", "cautious": "bound with friction, lag and friction near rest unknown"}


def main(count: int = FEW) -> list[Figure]:
    """Return the figures of a few motors, for `make bench`; those that are promised are of a thousand."""
    from population_parts.runs import outcomes, warmed_up

    warmed_up()
    return figures(outcomes(range(count)))


def smallest() -> list[Figure]:
    """Return the figures of four motors and of two that depart from the model."""
    from population_parts.departures import DEPARTURES
    from population_parts.runs import outcomes

    return [*figures(outcomes(range(4))), *departed("play", outcomes(range(2), DEPARTURES["play"]))]


def figures(rows: Sequence[Row]) -> list[Figure]:
    """Return all figures of plain motors."""
    return [*_verdicts(rows), *_intervals(rows), *_widths(rows), *_false_causes(rows), *_cost(rows)]


def departed(name: str, rows: Sequence[Row]) -> list[Figure]:
    """Return the figures of motors that depart from the model: verdicts, and how much too narrow intervals are."""
    from population_parts.judge import factors, off, quantile, share

    trusted = [row for row in rows if row["verdict"] == "trusted"]
    what = f"{name}: "
    return [
        *_shares_of_verdicts(rows, what),
        Figure(
            what=f"{what}trusted and more than 3 sd off, of {len(trusted)}",
            value=share(sum(bool(off(row)) for row in trusted), len(trusted)),
            unit="%",
        ),
        Figure(what=f"{what}widening of the trusted", value=quantile(factors(trusted), 0.95), unit="times"),
        Figure(
            what=f"{what}widening that covers 95 %",
            value=quantile(factors(rows), 0.95),
            unit="times",
            goal="at most 1.2",
        ),
    ]


def _shares_of_verdicts(rows: Sequence[Row], of: str = "") -> list[Figure]:
    from population_parts.judge import share

    return [
        Figure(
            what=f"{of}{verdict}, of {len(rows)}",
            value=share(sum(row["verdict"] == verdict for row in rows), len(rows)),
            unit="%",
        )
        for verdict in _VERDICTS
    ]


def _verdicts(rows: Sequence[Row]) -> list[Figure]:
    from population_parts.judge import is_knowable, knows, off, share

    knowable = [row for row in rows if is_knowable(row)]
    trusted = [row for row in rows if row["verdict"] == "trusted"]
    wrong = [row for row in trusted if off(row)]
    names = ", ".join(str(row["number"]) for row in wrong)
    return [
        *_shares_of_verdicts(rows),
        Figure(
            what=f"trusted, of {len(knowable)} that could be known to 2 %",
            value=share(sum(row["verdict"] == "trusted" for row in knowable), len(knowable)),
            unit="%",
            goal="at least 80",
        ),
        Figure(
            what=f"trusted, gain and time constant stated by themselves, of {len(knowable)} that could be known to 2 %",
            value=share(sum(row["verdict"] == "trusted" and knows(row) for row in knowable), len(knowable)),
            unit="%",
        ),
        Figure(
            what=f"trusted and anything more than 3 sd off, of {len(trusted)}" + (f" (numbers {names})" if wrong else ""),
            value=share(len(wrong), len(trusted)),
            unit="%",
            goal="at most 1.5",
        ),
    ]  # fmt: skip


def _intervals(rows: Sequence[Row]) -> list[Figure]:
    from population_parts.judge import COVERED, TOGETHER, bounded, coverage, share

    held, count = bounded(rows)
    what = f"upper ends of bounded parameters above what is true, of {count}"
    found = [Figure(what=what, value=share(held, count), unit="%", goal="at least 96")]
    for verdict, group in (("", rows), ("trusted: ", [r for r in rows if r["verdict"] == "trusted"])):
        for name in (*COVERED, *TOGETHER):
            held, count = coverage(group, name)
            found.append(
                Figure(
                    what=f"{verdict}intervals that hold the {name.replace('_', ' ')}, of {count}",
                    value=share(held, count),
                    unit="%",
                    goal="93 to 97.5",
                )
            )
    return found


def _widths(rows: Sequence[Row]) -> list[Figure]:
    from population_parts.judge import SEVERAL, quantile, ratios

    several = [row for row in rows if row["events"] >= SEVERAL]
    found = []
    for beside, whose in _BOUNDS.items():
        for name in ("gain", "time_constant"):
            values = ratios(several, name, beside)
            what = f"stated sd over {whose}, {name.replace('_', ' ')}, several events, of {len(values)}: "
            found += [
                Figure(what=f"{what}median", value=quantile(values, 0.5), unit="bounds", goal="at most 1.15"),
                Figure(what=f"{what}p90", value=quantile(values, 0.9), unit="bounds", goal="at most 2"),
            ]
    return found


def _false_causes(rows: Sequence[Row]) -> list[Figure]:
    from population_parts.judge import causes, share

    told = [causes(row) for row in rows]
    each = sorted({code for codes in told for code in codes})
    total = Figure(
        what=f"told a cause that isn't there, of {len(rows)}",
        value=share(sum(bool(codes) for codes in told), len(rows)),
        unit="%",
        goal="at most 3",
    )
    return [
        total,
        *(
            Figure(
                what=f"  {code}",
                value=share(sum(code in codes for codes in told), len(rows)),
                unit="%",
                goal="at most 0.5",
            )
            for code in each
        ),
    ]


def _cost(rows: Sequence[Row]) -> list[Figure]:
    from population_parts.judge import quantile

    seconds = [row["seconds"] for row in rows]
    limits = ((0.5, "p50", "0.1"), (0.99, "p99", "1.5"), (1.0, "longest", "5"))
    return [
        Figure(what=f"processor time, {name}", value=quantile(seconds, q), unit="s", goal=f"at most {goal}")
        for q, name, goal in limits
    ]


def command(words: Sequence[str]) -> int:
    """Identify motors, print a line each and the figures; returns the exit status."""
    from population_parts.departures import DEPARTURES
    from population_parts.page import line
    from population_parts.runs import outcomes, warmed_up

    asked = _parser(list(DEPARTURES)).parse_args(words)
    if asked.from_table:
        return shown(figures(json.loads(asked.from_table.read_text(encoding="utf-8"))))
    names = list(DEPARTURES) if asked.model_error == "all" else [asked.model_error]
    rows: list[Row] = []
    found: list[Figure] = []

    def show(row: Row) -> None:
        rows.append(row)
        print(line(row), flush=True)
        if asked.table:
            asked.table.write_text(json.dumps(rows), encoding="utf-8")

    warmed_up()
    if asked.model_error is None:
        numbers = range(asked.first, asked.first + (asked.count or COUNT))
        return shown(figures(outcomes(numbers, show=show)))
    for name in names:
        numbers = range(asked.first, asked.first + (asked.count or DEPARTED))
        found += departed(name, outcomes(numbers, DEPARTURES[name], show))
    return shown(found)


def _parser(names: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description="Answers on random motors, held against the truth.")
    parser.add_argument("--count", type=int, help=f"how many motors ({COUNT}; {DEPARTED} with a model error)")
    parser.add_argument("--from", type=int, default=0, dest="first", help="number of the first (%(default)s)")
    parser.add_argument("--model-error", choices=[*names, "all"], help="motors that depart from the model")
    parser.add_argument("--table", type=Path, help="keep what came of each motor in this file (JSON)")
    parser.add_argument("--from-table", type=Path, help="judge what is kept in such a file")
    return parser


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))

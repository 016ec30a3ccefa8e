"""The peer table's arithmetic: from the answers to errors, ranks and their Monte Carlo errors, and to Markdown."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Row = Mapping[str, str]
What = Literal["gain", "time_constant"]
Truth = Mapping[tuple[str, int], Mapping[What, float]]

COLUMNS = (
    "date", "set", "run", "tool", "method", "status", "gain", "time_constant", "gain_low", "gain_high",
    "time_constant_low", "time_constant_high", "interval_from", "seconds", "note",
)  # fmt: skip
WHATS: tuple[What, ...] = get_args(What)
NO_ANSWER = 100.0  # %: the error that a fit without an answer counts for
DRAWS = 4000
SEED = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Score:
    """One parameter's errors of one method over all runs [%]: median, root mean square with its Monte Carlo sd, rank.

    `rank` holds the smallest and the largest rank that are met in 95 % of the bootstrap's draws. `covered` counts the intervals
    that hold the truth.
    """

    median: float
    rmse: float
    rmse_sd: float
    rank: tuple[int, int]
    covered: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """One method on one set: its scores, how many runs had an answer and an interval, and the median time of a fit [s]."""

    tool: str
    method: str
    scores: Mapping[What, Score]
    answers: int
    runs: int
    intervals: int
    interval_from: str
    seconds: float
    why_not: str


def read_rows(paths: Iterable[Path]) -> list[Row]:
    """Return the rows of result files; raises `SystemExit` for a file that lacks a column."""
    rows: list[Row] = []
    for path in paths:
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            lacking = set(COLUMNS) - set(reader.fieldnames or ())
            if lacking:
                raise SystemExit(
                    f"{path}: no column {', '.join(sorted(lacking))}; expected {', '.join(COLUMNS)}"
                )
            rows += list(reader)
    return rows


def read_truth(path: Path) -> dict[tuple[str, int], dict[What, float]]:
    """Return what is to be found, by set and run."""
    with open(path, newline="", encoding="utf-8") as file:
        return {
            (row["set"], int(row["run"])): {what: float(row[what]) for what in WHATS}
            for row in csv.DictReader(file)
        }


def percent_errors(rows: Iterable[Row], truth: Truth, name: str, what: What) -> Array:
    """Return the errors of one method's parameter on one set (R,) [%]; a run without an answer counts as 100 %."""
    runs = sorted(run for other, run in truth if other == name)
    errors = dict.fromkeys(runs, NO_ANSWER)
    for row in rows:
        run = int(row["run"])
        if row["set"] == name and row["status"] == "ok" and run in errors:
            errors[run] = 100.0 * (float(row[what]) / truth[name, run][what] - 1.0)
    return np.array(list(errors.values()))


def rmse(errors: Array) -> Array:
    """Return the root mean square over the last axis."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=-1)))


def draws(runs: int, count: int = DRAWS, seed: int = SEED) -> NDArray[np.int64]:
    """Return the runs that each draw of the bootstrap is made of (count, runs), the same for all methods."""
    return np.random.default_rng(seed).integers(0, runs, (count, runs))


def ranks(values: Array) -> NDArray[np.int64]:
    """Return the rank of each value along the first axis: 1 and the number of smaller ones; equal values share a rank."""
    return np.array([1 + np.sum(values < value, axis=0) for value in values])


def scores(errors: Array, drawn: NDArray[np.int64], covered: Sequence[int]) -> list[Score]:
    """Return the scores of M methods from their errors (M, R), with the bootstrap over runs (B, R) for the Monte Carlo errors."""
    again = np.array([rmse(row[drawn]) for row in errors])  # (M, B)
    low, high = np.percentile(ranks(again), [2.5, 97.5], axis=1, method="nearest")
    return [
        Score(
            median=float(np.median(row)),
            rmse=float(rmse(row)),
            rmse_sd=float(np.std(again[m], ddof=1)),
            rank=(int(low[m]), int(high[m])),
            covered=covered[m],
        )
        for m, row in enumerate(errors)
    ]


def least_covered(runs: int, level: float = 0.95, tail: float = 0.025) -> int:
    """Return how many of the runs' intervals must hold the truth, or their coverage is below the level (binomial law)."""
    total = 0.0
    for k in range(runs + 1):
        total += math.comb(runs, k) * level**k * (1.0 - level) ** (runs - k)
        if total > tail:
            return k
    return runs


def lines(rows: Sequence[Row], truth: Truth, name: str) -> list[Line]:
    """Return the table of one set, the smallest geometric mean of both RMSE first; methods without any answer come last."""
    methods = list(dict.fromkeys(row["method"] for row in rows if row["set"] == name))
    runs = sum(other == name for other, _ in truth)
    of = {
        m: [r for r in rows if r["method"] == m and r["set"] == name and int(r["run"]) < runs]
        for m in methods
    }
    answered = [m for m in methods if any(row["status"] == "ok" for row in of[m])]
    drawn = draws(runs)
    by_what = {
        what: scores(
            np.array([percent_errors(of[m], truth, name, what) for m in answered]).reshape(-1, runs),
            drawn,
            [sum(_covers(row, truth, what) for row in of[m]) for m in answered],
        )
        for what in WHATS
    }
    found = [
        _line(of[m], {what: by_what[what][k] for what in WHATS}, runs) for k, m in enumerate(answered)
    ] + [_line(of[m], {}, runs) for m in methods if m not in answered]
    return sorted(
        found, key=lambda line: math.prod(s.rmse for s in line.scores.values()) if line.scores else math.inf
    )


def _line(rows: Sequence[Row], by_what: Mapping[What, Score], runs: int) -> Line:
    good = [row for row in rows if row["status"] == "ok"]
    timed = [float(row["seconds"]) for row in good if row["seconds"]]
    reasons = [row["status"] for row in rows if row["status"] != "ok"]
    return Line(
        tool=rows[0]["tool"],
        method=rows[0]["method"],
        scores=by_what,
        answers=len(good),
        runs=runs,
        intervals=sum(_has_interval(row) for row in good),
        interval_from=next((row["interval_from"] for row in good if row["interval_from"]), ""),
        seconds=float(np.median(timed)) if timed else math.nan,
        why_not=max(reasons, key=reasons.count) if reasons else "",
    )


def _has_interval(row: Row) -> bool:
    ends = [row[f"{what}_{end}"] for what in WHATS for end in ("low", "high")]
    return all(ends) and all(math.isfinite(float(end)) for end in ends)


def _covers(row: Row, truth: Truth, what: What) -> bool:
    if row["status"] != "ok" or not _has_interval(row):
        return False
    value = truth[row["set"], int(row["run"])][what]
    return float(row[f"{what}_low"]) <= value <= float(row[f"{what}_high"])


HEADINGS = (
    "method", "rank K", "rank τ", "K median %", "K RMSE %", "τ median %", "τ RMSE %",
    "interval", "coverage K, τ", "answers", "s per fit",
)  # fmt: skip


def markdown(table: Iterable[Line]) -> str:
    """Return the table of one set in Markdown."""
    rows = [HEADINGS, ("---",) * len(HEADINGS), *(_cells(line) for line in table)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _cells(line: Line) -> tuple[str, ...]:
    answers = f"{line.answers}/{line.runs}" + (f" ({line.why_not})" if line.why_not else "")
    seconds = "" if math.isnan(line.seconds) else f"{line.seconds:.2g}"
    if not line.scores:
        return (line.method, "none", "none", "", "", "", "", "", "", answers.replace("|", "/"), seconds)
    k, tau = line.scores["gain"], line.scores["time_constant"]
    whose = {"tool": "yes", "hand": "by hand"}.get(line.interval_from, "no")
    n = line.intervals
    coverage = f"{100 * k.covered / n:.0f}, {100 * tau.covered / n:.0f} %" if n else ""
    return (
        line.method,
        shown_rank(k.rank),
        shown_rank(tau.rank),
        shown_median(k),
        shown_error(k),
        shown_median(tau),
        shown_error(tau),
        whose,
        coverage,
        answers.replace("|", "/"),
        seconds,
    )


def shown_rank(rank: tuple[int, int]) -> str:
    """Return a rank with its Monte Carlo error: "1" where it is certain, otherwise "2-3"."""
    low, high = rank
    return str(low) if low == high else f"{low}-{high}"


def shown_median(score: Score) -> str:
    """Return a median with its sign, to two digits."""
    return f"{score.median:+.0f}" if abs(score.median) >= 99.5 else f"{score.median:+.2g}"


def shown_error(score: Score) -> str:
    """Return an RMSE with its Monte Carlo standard deviation, both to the second digit of the latter."""
    if score.rmse_sd <= 0.0:
        return f"{score.rmse:.3g}"
    places = 1 - math.floor(math.log10(score.rmse_sd))
    digits = min(max(places, 0), 8)
    return f"{score.rmse:.{digits}f} ± {score.rmse_sd:.{digits}f}"

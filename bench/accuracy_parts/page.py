"""The table in words and in figures: docs/benchmarks/accuracy.md and accuracy.json."""

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from accuracy_parts.rows import KNOWN, LIMIT, OUTSIDE, Row
from accuracy_parts.storage import kept
from accuracy_parts.summary import Accuracy, Share, Summary, summarised

_WRONG = 0.03  # the goal: trusted and wrong at most this often


def write(rows: Sequence[Row], work: Path, out: Path, codes: Mapping[str, str]) -> None:
    """Write both files from the runs that are kept; rows without any are left out. `codes` are the fingerprints by name."""
    found = {row.name: runs for row in rows if (runs := kept(work, row, codes[row.name]))}
    if not found:
        return
    summaries = [(row, summarised(found[row.name])) for row in rows if row.name in found]
    out.mkdir(parents=True, exist_ok=True)
    made = _made()
    (out / "accuracy.md").write_text(markdown(summaries, made), encoding="utf-8")
    figures = [
        {"row": row.name, "part": row.part, "words": row.words, **asdict(summary)}
        for row, summary in summaries
    ]
    text = json.dumps({**made, "rows": figures}, indent=1, ensure_ascii=False)
    (out / "accuracy.json").write_text(text + "\n", encoding="utf-8")


def markdown(summaries: Sequence[tuple[Row, Summary]], made: dict[str, Any]) -> str:
    """Return the page."""
    lines = [
        "# Accuracy, coverage and verdicts",
        "",
        f"Made by `python bench/accuracy.py` on {made['date']} with servobench {made['version']}, on {made['machine']}.",
        "",
        *_WORDS,
        "",
        f"## {LIMIT}",
        "",
        *_LIMIT_WORDS,
        "",
        *_limit_table([(row, s) for row, s in summaries if row.part == LIMIT]),
        "",
        *_gain_of_the_interval({row.name: s for row, s in summaries}),
        "## The verdict",
        "",
        *_VERDICT_WORDS,
        "",
    ]
    for part in (LIMIT, KNOWN, OUTSIDE):
        chosen = [(row, s) for row, s in summaries if row.part == part]
        if chosen:
            lines += [f"### {part}: the verdict", "", *_verdict_table(chosen), ""]
    lines += ["## What an estimate is held against", "", *_truths(summaries), ""]
    return "\n".join(lines)


_WORDS = (
    "Every run draws a motor (inertia and torque constant within ±5 %), the phase of the input and the start, simulates 10 s",
    "at 500 Hz behind an encoder with 2048 counts a turn, and identifies with everything on `auto` where nothing else is said.",
    "The simulators share no line with servobench (`bench/accuracy_parts`). Brackets hold the range in which the true figure",
    "lies with a probability of 95 %, given the number of runs.",
)
_LIMIT_WORDS = (
    "RMSE and mean error are in units of the Cramér-Rao bound, ± their Monte Carlo standard deviation. The bound is",
    "Gaussian-equivalent (rounding counts as white noise of variance Q²/12), with offset, delay and start state unknown. It",
    "comes from differences of an exact simulation and, under a random torque, a Kalman filter with the true noise levels. An",
    "ideal encoder's error isn't random, so that a little less than 1 is possible.",
)
_VERDICT_WORDS = (
    "*Trusted and wrong*: the verdict is trusted, and gain or time constant is more than 3 standard deviations from the truth;",
    "the aim is at most 3 %. *Doubted and fine*: doubtful or refused, though both are within 3 standard deviations. *Coverage*",
    "is that of the 95 % intervals of both, where the verdict is trusted. *Error* is the larger of the two relative errors, the",
    "median over the runs that were trusted and wrong.",
)
_ROW = ("row", "runs")
_LIMIT_HEAD = (
    *("RMSE K", "RMSE τ"),
    *("RMSE/bound K", "RMSE/bound τ", "bias/bound K", "bias/bound τ"),
    *("coverage K", "coverage τ", "estimator"),
)
_VERDICT_HEAD = (
    *("trusted", "trusted and wrong", "doubted and fine"),
    *("coverage if trusted", "error", "why not trusted"),
)


def _limit_table(rows: Sequence[tuple[Row, Summary]]) -> list[str]:
    cells = []
    for row, s in rows:
        both = [s.accuracy["gain"], s.accuracy["time_constant"]]
        coverages = [_share(a.coverage) for a in both]
        runs = f"{s.runs} ({s.failed} without a fit)" if s.failed else str(s.runs)
        cells.append(
            (
                row.words,
                runs,
                *map(_relative, both),
                *map(_rmse, both),
                *map(_bias, both),
                *coverages,
                _shares(s.estimators),
            )
        )
    return _table((*_ROW, *_LIMIT_HEAD), cells)


def _gain_of_the_interval(found: Mapping[str, Summary]) -> list[str]:
    """By how much the interval likelihood is better on the same data, in a sentence; nothing without both rows."""
    if not {"fine_noise", "fine_noise_interval"} <= set(found):
        return []
    pairs = [
        (found["fine_noise"].accuracy[name].relative, found["fine_noise_interval"].accuracy[name].relative)
        for name in ("gain", "time_constant")
    ]
    k, tau = (plain / fine if plain and fine else float("nan") for plain, fine in pairs)
    words = f"With 0.05 count of noise, output error's RMSE is {k:.2f} (K) and {tau:.2f} (τ) times the interval likelihood's."
    return [words, ""]


def _verdict_table(rows: Sequence[tuple[Row, Summary]]) -> list[str]:
    cells = []
    for row, s in rows:
        wrong = _share(s.trusted_and_wrong)
        cells.append(
            (
                row.words,
                str(s.runs),
                f"{100 * s.trusted.value:.0f} %",
                f"**{wrong}**" if s.trusted_and_wrong.value > _WRONG else wrong,
                _share(s.fine_but_not_trusted),
                _share(s.coverage_given_trusted) if s.trusted.count else "",
                "" if s.error_when_wrong is None else f"{s.error_when_wrong:.2g} %",
                _shares(s.warnings),
            )
        )
    return _table((*_ROW, *_VERDICT_HEAD), cells)


def _truths(summaries: Sequence[tuple[Row, Summary]]) -> list[str]:
    """One line for each kind of plant: what it is, and its truth."""
    kinds = {type(row.plant): None for row, _ in summaries}
    return [
        f"- **{kind.__name__}**: {(kind.__doc__ or '').splitlines()[0]} Truth: {kind.truth}."
        for kind in kinds
    ]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(line)} |" for line in (head, ["---"] * len(head), *rows)]


def _relative(a: Accuracy) -> str:
    return "" if a.relative is None else f"{100 * a.relative:.2g} %"


def _rmse(a: Accuracy) -> str:
    return "" if a.rmse is None else f"{a.rmse:.3f} ± {a.rmse_sd:.3f}"


def _bias(a: Accuracy) -> str:
    return "" if a.bias is None else f"{a.bias:+.3f} ± {a.bias_sd:.3f}"


def _share(share: Share) -> str:
    low, high = share.range
    return f"{100 * share.value:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def _shares(shares: dict[str, float]) -> str:
    return ", ".join(f"{name} {100 * value:.0f} %" for name, value in shares.items())


def _made() -> dict[str, Any]:
    """The machine and the versions."""
    import numba
    import numpy

    from servobench._version import __version__

    system = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    versions = f"Python {platform.python_version()}, NumPy {numpy.__version__}, Numba {numba.__version__}"
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "version": __version__,
        "machine": f"{system}, {versions}",
    }

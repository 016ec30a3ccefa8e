"""The page docs/benchmarks/peers.md: what was asked of whom, the tables, and where servobench stands in them."""

from __future__ import annotations

import platform
import shutil
import subprocess
from collections.abc import Sequence
from datetime import date
from importlib import metadata
from pathlib import Path

import make_data
import table

OURS = "servobench_auto"
ABSENT = {
    "matlab": "MATLAB System Identification Toolbox (`procest` P1ID on position, `tfest` on speed)",
    "contsid": "CONTSID (`tfsrivc` on speed)",
}

HEAD = """# The peer table

Written by `python bench/peers/run.py` on {today}; the fits are of {dates}. {runs} runs for each row, seed {seed}.
Python {python}, {machine}, one thread, other work on the same machine: times are good to a factor of two.
{versions}

Every tool gets the same data: a motor with K ≈ 23.3 rad/s/V and τ ≈ 0.098 s (both vary from run to run), Coulomb friction of
1.5e-3 N·m (0.3 V), 5,000 samples of 2 ms, an encoder with 2048 counts a revolution, and no delay. The simulator is
`bench/peers/make_data.py`, which shares nothing with servobench. Linear tools get the difference of the positions over
the sample time as a speed, once as it is and once with the means taken out of voltage and speed ("detrended").
Their discrete pole a becomes τ = -T/ln a.

How to read a row:

- *Median* and *RMSE* are of the error in % of the truth. After ± stands the Monte Carlo standard deviation of the RMSE.
- *Rank* is by RMSE within its table, 1 is the best; "2-3" means that 95 % of the bootstrap's draws over the runs
  ({draws} of them, the same runs for all rows) lie there. A fit without an answer counts as an error of 100 %.
- *Interval*: whether the tool gives one for K and τ. "By hand" means worked out for this table from a covariance or a Jacobian;
  *coverage* is how many of the 95 % intervals hold the truth. With {runs} runs, a true 95 % shows as anything from {least} % on.
- "scipy position OE" is no tool but what somebody writes who knows the motor's equations and the terms that matter.
  `+ offset` and `+ friction` are told that there is no delay, and which friction there is; servobench is told neither.
"""

TITLES = {
    "coulomb": "Coulomb friction, turning one way (square wave, 1 to 3 V, 0.4 Hz)",
    "disturbance": "The same with a random torque of 1e-5 N·m/√Hz",
    "reversals": "Coulomb friction with reversals (square wave, ±3 V, 0.4 Hz, from rest)",
}


def page(rows: Sequence[table.Row], truth: table.Truth, requirements: Path, seed: str) -> str:
    """Return the whole page in Markdown."""
    runs = 1 + max(run for _, run in truth)
    dates = sorted({row["date"] for row in rows if row["date"]})
    head = HEAD.format(
        today=date.today().isoformat(),
        dates=" to ".join(dict.fromkeys([dates[0], dates[-1]])) if dates else "no date",
        runs=runs,
        seed=seed,
        python=platform.python_version(),
        machine=f"{platform.system()} {platform.machine()}",
        versions=versions(requirements),
        draws=table.DRAWS,
        least=f"{100 * table.least_covered(runs) / runs:.0f}",
    )
    parts = [head]
    for name in make_data.SETS:
        lines = table.lines(rows, truth, name)
        parts += [f"## {TITLES[name]}\n", place(lines), table.markdown(lines) + "\n"]
    return "\n".join([*parts, not_run({row["tool"] for row in rows})])


def place(lines: Sequence[table.Line]) -> str:
    """Return a sentence with servobench's ranks in a table."""
    ours = [line for line in lines if line.tool == OURS and line.scores]
    ranked = sum(bool(line.scores) for line in lines)
    return "".join(
        f"`{line.method}`: rank {table.shown_rank(line.scores['gain'].rank)} for K and "
        f"{table.shown_rank(line.scores['time_constant'].rank)} for τ, of {ranked}.\n"
        for line in ours
    )


def versions(requirements: Path) -> str:
    """Return what was measured in a sentence: servobench with its commit, the peers as pinned, Octave where there is one."""
    pins = [line.split("#")[0].strip() for line in requirements.read_text(encoding="utf-8").splitlines()]
    named = [f"servobench {metadata.version('servobench')}{_commit()}", *(pin for pin in pins if pin)]
    if shutil.which("octave-cli"):
        said = subprocess.run(["octave-cli", "--version"], capture_output=True, text=True).stdout
        named.append(said.splitlines()[0] if said else "GNU Octave")
    return "Measured: " + ", ".join(name.replace("==", " ") for name in named) + "."


def _commit() -> str:
    if shutil.which("git") is None:
        return ""
    here = Path(__file__).resolve().parent
    head = subprocess.run(
        ["git", "describe", "--always", "--dirty=, with changes"], cwd=here, capture_output=True, text=True
    ).stdout.strip()
    return f" ({head})" if head else ""


def not_run(tools: set[str]) -> str:
    """Return a section on the tools that nobody has run yet; empty where there are none."""
    absent = [text for name, text in ABSENT.items() if not any(tool.startswith(name) for tool in tools)]
    if not absent:
        return ""
    items = "\n".join(f"- {text}" for text in absent)
    return (
        "## Not run\n\n"
        f"{items}\n\n"
        "Nobody here has them. The scripts in `bench/peers/matlab` read the same data and write the same columns;\n"
        "they have never run under MATLAB.\n"
        "`python bench/peers/run.py --add results_matlab.csv` puts their answers into the tables.\n"
    )

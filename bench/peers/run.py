"""The peer table: `python bench/peers/run.py --runs 30` makes the data, lets every tool fit them and writes the page.

Each tool runs in a process of its own, the peers in an environment of their own, with a limit on the time of each fit.
Failures and time-outs are rows too.

`--tools sippy` repeats one tool and keeps the others' answers; `--add results.csv` adds answers from
elsewhere, such as MATLAB's; `--table` only writes the table again.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import venv
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import make_data
import page
import table

HERE = Path(__file__).resolve().parent
TOOLS = HERE / "tools"
PAGE = HERE.parent.parent / "docs" / "benchmarks" / "peers.md"
OWN = {"servobench_auto"}  # runs in the environment of this very process, where servobench is installed
START = 120.0  # s for a process to import its tool, on top of its first fit
LOST = 2  # time-outs or crashes in a row after which a method's other runs aren't tried


@dataclass(frozen=True, kw_only=True)
class Task:
    """One method of one tool on one set, and the interpreter that it runs in."""

    python: Path
    tool: str
    method: str
    set: str
    data: Path
    runs: int
    limit: float


def made_data(folder: Path, runs: int, seed: int, samples: int) -> None:
    """Make the data unless they are there already; answers to other data are thrown away.

    Data of another number of `samples` are for a folder of their own.
    """
    stamp = folder / "made.json"
    asked = json.dumps({"runs": runs, "seed": seed})
    if stamp.exists() and stamp.read_text(encoding="utf-8") == asked:
        return
    shutil.rmtree(folder / "results", ignore_errors=True)
    print(f"making the data: {runs} runs of {', '.join(make_data.SETS)}", file=sys.stderr)
    make_data.write(folder, runs, seed, samples)
    stamp.write_text(asked, encoding="utf-8")


def seed_of(folder: Path) -> str:
    """Return the seed that the data in a folder were made with, as far as that is known."""
    stamp = folder / "made.json"
    return str(json.loads(stamp.read_text(encoding="utf-8"))["seed"]) if stamp.exists() else "unknown"


def interpreter(tool: str, folder: Path) -> Path:
    """Return the interpreter of a tool's environment, which is made where it isn't there yet.

    All tools share that of requirements.txt, but one whose packages don't go with the others': it has a `requirements-TOOL.txt`.
    """
    if tool in OWN:
        return Path(sys.executable)
    own = HERE / f"requirements-{tool}.txt"
    wanted = own if own.exists() else HERE / "requirements.txt"
    place = folder / f"env-{wanted.stem}"
    python = place / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    stamp = place / "installed.txt"
    text = wanted.read_text(encoding="utf-8")
    if not (stamp.exists() and stamp.read_text(encoding="utf-8") == text):
        print(f"installing {wanted.name} into {place}", file=sys.stderr)
        venv.create(place, with_pip=True, clear=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", "--quiet", "-r", wanted], check=True)
        stamp.write_text(text, encoding="utf-8")
    return python


def surroundings() -> dict[str, str]:
    """Return the environment of a worker: one thread, no windows, no paths of ours."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return kept | threads | {"MPLBACKEND": "Agg", "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}


def methods(python: Path, tool: str) -> list[str]:
    """Return the names of a tool's methods; raises `CalledProcessError` where it can't be imported."""
    words = [python, HERE / "worker.py", tool]
    asked = subprocess.run(words, capture_output=True, text=True, check=True, env=surroundings(), timeout=600)
    names: list[str] = json.loads(asked.stdout)
    return names


def outcomes(task: Task) -> Iterator[dict[str, object]]:
    """Yield one outcome for each run; a process that takes too long is ended, and another goes on with the next run."""
    run, lost = 0, 0
    while run < task.runs:
        if lost >= LOST:
            yield {"run": run, "status": f"not tried after {lost} losses in a row"}
            run += 1
            continue
        for found in _from_one_process(task, run):
            yield found
            run += 1
            lost = lost + 1 if str(found["status"]).startswith(("timed out", "crashed")) else 0


def _from_one_process(task: Task, first: int) -> Iterator[dict[str, object]]:
    """Yield the outcomes of one worker; the last one says so where it had to be ended or crashed."""
    words = [task.python, HERE / "worker.py", task.tool, task.method, task.data, str(first)]
    with subprocess.Popen(
        words,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        encoding="utf-8",
        env=surroundings(),
    ) as worker:
        said: queue.Queue[str] = queue.Queue()
        reader = threading.Thread(target=_read, args=(worker, said), daemon=True)
        reader.start()
        for run in range(first, task.runs):
            try:
                line = said.get(timeout=task.limit + (START if run == first else 0.0))
            except queue.Empty:
                worker.kill()
                yield {"run": run, "status": f"timed out: more than {task.limit:g} s"}
                return
            if not line:
                worker.wait()
                yield {"run": run, "status": f"crashed: exit status {worker.returncode}"}
                return
            yield json.loads(line)


def _read(worker: subprocess.Popen[str], said: queue.Queue[str]) -> None:
    for line in worker.stdout or ():
        said.put(line)
    said.put("")


def as_row(task: Task, found: dict[str, object]) -> dict[str, str]:
    """Return an outcome as a row of the result file."""
    row = {"date": date.today().isoformat(), "set": task.set, "tool": task.tool, "method": task.method}
    for what in table.WHATS:
        ends = found.get(f"{what}_interval") or ("", "")
        found = found | {f"{what}_low": ends[0], f"{what}_high": ends[1]}
    for name in table.COLUMNS:
        if name not in row:
            value = found.get(name, "")
            row[name] = repr(value) if isinstance(value, float) else " ".join(str(value or "").split())
    return row | {"run": str(found["run"])}


def measure(tool: str, folder: Path, runs: int, limit: float) -> None:
    """Let a tool fit all sets, and write its result file after each method, as some take long."""
    rows: list[dict[str, str]] = []
    try:
        python = interpreter(tool, folder)
        names = methods(python, tool)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        said = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
        print(f"{tool}: can't be run here: {said}", file=sys.stderr)
        return
    for method in names:
        for name in make_data.SETS:
            start = time.perf_counter()
            data = folder / f"{name}.npz"
            task = Task(python=python, tool=tool, method=method, set=name, data=data, runs=runs, limit=limit)
            found = [as_row(task, outcome) for outcome in outcomes(task)]
            good = sum(row["status"] == "ok" for row in found)
            took = time.perf_counter() - start
            print(f"{method}, {name}: {good} of {runs} answers in {took:.1f} s", file=sys.stderr)
            rows += found
        write_results(folder / "results" / f"{tool}.csv", rows)


def write_results(path: Path, rows: list[dict[str, str]]) -> None:
    """Write a result file."""
    path.parent.mkdir(exist_ok=True)
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, table.COLUMNS)
        writer.writeheader()
        writer.writerows(rows)


def tools() -> list[str]:
    """Return the names of all tools."""
    return sorted(path.stem for path in TOOLS.glob("*.py"))


def asked(words: list[str]) -> argparse.Namespace:
    """Return what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=make_data.SEED)
    parser.add_argument("--folder", type=Path, default=HERE / "data", help="data, environments and answers")
    parser.add_argument(
        "--tools", nargs="+", choices=tools(), help="only these; the answers of the others stay"
    )
    parser.add_argument("--limit", type=float, default=30.0, help="seconds for a fit")
    parser.add_argument("--add", type=Path, nargs="+", default=[], help="result files from elsewhere")
    parser.add_argument("--table", action="store_true", help="only write the table again")
    parser.add_argument("--page", type=Path, default=PAGE)
    return parser.parse_args(words)


def main(words: list[str], samples: int = make_data.SAMPLES) -> None:
    """Do what the command line asks for, with records of so many samples where they are made."""
    wish = asked(words)
    wish.folder.mkdir(parents=True, exist_ok=True)
    if not (wish.table or wish.add):
        made_data(wish.folder, wish.runs, wish.seed, samples)
        for tool in wish.tools or tools():
            measure(tool, wish.folder, wish.runs, wish.limit)
    for path in wish.add:
        table.read_rows([path])
        (wish.folder / "results").mkdir(exist_ok=True)
        shutil.copy(path, wish.folder / "results" / path.name)
    rows = table.read_rows(sorted((wish.folder / "results").glob("*.csv")))
    truth = table.read_truth(wish.folder / "truth.csv")
    wish.page.parent.mkdir(parents=True, exist_ok=True)
    wish.page.write_text(
        page.page(rows, truth, HERE / "requirements.txt", seed_of(wish.folder)), encoding="utf-8"
    )
    print(f"wrote {wish.page}", file=sys.stderr)


def smallest() -> list[str]:
    """Let our own tool fit a short run of each set, its page in a folder that is gone afterwards, and return the page's lines."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "peers.md"
        words = ["--runs", "1", "--tools", *sorted(OWN), "--folder", f"{folder}/data", "--page", str(made)]
        main(words, samples=1500)
        return made.read_text(encoding="utf-8").splitlines()


if __name__ == "__main__":
    main(sys.argv[1:])

"""Run one method of one tool over a set, from a run on: `python worker.py TOOL METHOD DATA.npz FIRST`.

With a tool's name alone it lists the tool's methods. Runs in the peer's own environment. One line of JSON on standard output for
each run; what the peer prints goes to standard error.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import time
import warnings
from dataclasses import asdict
from pathlib import Path
from types import ModuleType

import numpy as np
from record import Method, NoAnswer, Record

TOOLS = Path(__file__).resolve().parent / "tools"


def tool(name: str) -> ModuleType:
    """Return a tool's module, under a name that can't be taken for the peer's own."""
    spec = importlib.util.spec_from_file_location(f"tool_{name}", TOOLS / f"{name}.py")
    if spec is None or spec.loader is None:
        raise SystemExit(f"no tool called {name} in {TOOLS}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def outcome(method: Method, record: Record) -> dict[str, object]:
    """Return a fit's answer as plain data, with its status and its time; a peer that fails says why."""
    start = time.perf_counter()
    try:
        answer = asdict(method(record))
    except NoAnswer as error:
        return {"status": f"no answer: {error}", "seconds": time.perf_counter() - start}
    except (Exception, SystemExit) as error:
        return {"status": f"failed: {type(error).__name__}: {error}", "seconds": time.perf_counter() - start}
    seconds = time.perf_counter() - start
    if not np.isfinite([answer["gain"], answer["time_constant"]]).all():
        return {"status": "no answer: not finite", "seconds": seconds}
    return answer | {"status": "ok", "seconds": answer["seconds"] or seconds}


def main(name: str, method: str = "", data: str = "", first: str = "0") -> None:
    """Write one line for each run, or the names of all methods."""
    lines = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    warnings.simplefilter("ignore")
    methods = tool(name).METHODS
    if not method:
        lines.write(json.dumps(list(methods)))
        return
    chosen = methods[method]
    with np.load(data) as arrays:
        records = [
            Record(t=arrays["t"], u=u, counts=c) for u, c in zip(arrays["u"], arrays["counts"], strict=True)
        ]
    if name.startswith("servobench"):
        outcome(chosen, records[0])  # loads the compiled code, which isn't the fit's time
    for run, record in enumerate(records[int(first) :], start=int(first)):
        lines.write(json.dumps({"run": run} | outcome(chosen, record)) + "\n")
        lines.flush()


def smallest() -> list[str]:
    """Return the methods of our own tool."""
    return list(tool("servobench_auto").METHODS)


if __name__ == "__main__":
    main(*sys.argv[1:])

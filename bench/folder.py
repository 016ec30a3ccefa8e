"""The cost of a file in a script that identifies a folder: reading included, one process, everything compiled.

500 files of 5,000 samples, as a logger writes them (CSV: time, voltage, angle in degrees). Beside it stands what it costs to read
the same files with pandas and do nothing.

    python bench/folder.py
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy is imported
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the tests' reference motor

import numpy as np
import pandas as pd
from figures import Figure, shown

import servobench as sb
from tests.datasets import dataset

FILES = 500
GOAL = 0.1  # s of processor time a file


def main(files: int = FILES, samples: int = 5000) -> list[Figure]:
    """Return the processor time of a file, and how many times that is of reading it only."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [_write(Path(folder), serial, samples) for serial in range(files)]
        _identify(paths[0])  # what is compiled is compiled now
        read, whole = [], []
        for path in paths:
            read.append(_seconds(lambda path=path: pd.read_csv(path)))
            whole.append(_seconds(lambda path=path: _identify(path)))
    half = tuple(np.percentile(whole, (25, 75)))
    ratio = statistics.median(one / other for one, other in zip(whole, read, strict=True))
    return [
        Figure(what="processor time of a file: read and identified", value=statistics.median(whole),
               half=half, unit="s", at_most=GOAL),
        Figure(what="that over reading it with pandas only", value=ratio, unit="times"),
    ]  # fmt: skip


def smallest() -> list[Figure]:
    """Return the figures of two files."""
    return main(files=2, samples=1000)


def _identify(path: Path) -> sb.Result:
    return sb.identify(path, output="angle:deg")


def _write(folder: Path, serial: int, samples: int) -> Path:
    data = dataset(seed=serial, kind="prbs", samples=samples)
    path = folder / f"motor_{serial:03}.csv"
    table = pd.DataFrame({"time": data.t_output, "voltage": data.u, "angle": np.degrees(data.y)})
    table.to_csv(path, index=False, float_format="%.9g")
    return path


def _seconds(work: Callable[[], object]) -> float:
    began = time.process_time()
    work()
    return time.process_time() - began


if __name__ == "__main__":
    raise SystemExit(shown(main()))

"""The cost of a fleet: the rate of `identify_fleet` against reading the same files and doing nothing, its memory, and kills.

Files of 5,000 samples in our own format, as CSV, and as TDMS; as many processes read them and do nothing. Rates are taken
from the first result to the last, so that neither has the start of its processes in it. The parts are the processor time that
a file takes in one process: to be read, to be identified, to become a row, and to be kept in the results. Memory is the most that
the parent had, as the rows go through it. A kill is SIGKILL at a random moment; afterwards the rows are counted.

    python bench/fleet.py [FILES] [FILES OF THE LARGE FLEET] [KILLS]
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core each, before NumPy is imported
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the tests' reference motor

import numpy as np
from figures import Figure, shown

from servobench.core.channels import Channel
from servobench.fleet.identification import identify_fleet, processors, results_of
from servobench.fleet.parts import rows_in
from servobench.fleet.pool import Processes
from servobench.fleet.row import result_row
from servobench.fleet.settings import Settings
from servobench.fleet.source import list_items, source_at
from servobench.identification.identify import identify_evidence
from servobench.recordings.formats.base import save
from servobench.recordings.loading.load import load
from servobench.recordings.reading import evidence_in
from servobench.recordings.recording import Recording, Series, Source
from tests.datasets import dataset

RATE = 0.5  # of reading and doing nothing, the goal of issue 20
FLAT = 1.1  # times
PARTS_OF = 20  # files
_KINDS = ("mcap", "csv", "tdms")
_PROGRAM = """
import resource, sys
from servobench.fleet.identification import identify_fleet
from servobench.fleet.settings import Settings
if __name__ == "__main__":
    identify_fleet(sys.argv[1], sys.argv[2], settings=Settings(options={"output": "angle:rad", "chain": "none"}), workers=1)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@dataclass(frozen=True, kw_only=True)
class Size:
    """The number and the length of the measurements."""

    files: int = 100
    large: int = 2000
    """Files of the large fleet."""
    kills: int = 20
    samples: int = 5000
    turns: int = 3
    workers: int = 2
    """Processes of a rate, where there are as many processors."""
    warm_up: bool = True
    """Whether a fleet goes first of which no time is taken."""


def main(size: Size = Size()) -> list[Figure]:
    """Return the rates for each kind of file, the memory of a large fleet over that of a small one, and rows lost or doubled."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        figures = [figure for kind in _KINDS for figure in _rates(place / kind, kind, size)]
        return [
            *figures,
            *_memory(place / "memory", max(8, size.large // 20), size.large),
            *_kills(place / "kills", size.kills),
        ]


def smallest() -> list[Figure]:
    """Return the figures of a few files and one kill, each rate taken once, of one process."""
    return main(Size(files=3, large=16, kills=1, samples=500, turns=1, workers=1, warm_up=False))


def _rates(folder: Path, kind: str, size: Size) -> list[Figure]:
    folder.mkdir()
    paths = [_write(folder, kind, serial, size.samples) for serial in range(size.files)]
    settings = Settings(options={"output": "angle:rad", "chain": "none"})
    count = min(processors(), size.workers)
    if size.warm_up:
        identify_fleet(folder, folder.parent / f"warm-{kind}", settings=settings, workers=count)
    ratios, rates = [], []
    for turn in range(size.turns):
        with Processes(_read, count) as pool:
            looks = [time.perf_counter() for _ in pool.results(paths)]
        steps: list[float] = []
        identify_fleet(
            folder,
            folder.parent / f"{kind}-{turn}",
            settings=settings,
            workers=count,
            progress=partial(_note, steps),
        )
        whole = steps[-1] - steps[1]  # the first step is that nothing is done yet
        ratios.append((looks[-1] - looks[0]) / whole)
        rates.append((size.files - 1) / whole)
    return [
        Figure(what=f"{kind}: rate over reading and doing nothing", value=statistics.median(ratios),
               half=(min(ratios), max(ratios)), goal=f"at least {RATE:g}"),
        Figure(what=f"{kind}: files a second, {count} processes", value=statistics.median(rates), unit="1/s"),
        *_parts(folder, kind, settings),
    ]  # fmt: skip


def _parts(folder: Path, kind: str, settings: Settings) -> list[Figure]:
    """What a file takes [ms], by what is done with it."""
    source = source_at(folder)
    items = list_items(source, None).items[:PARTS_OF]
    spent: dict[str, list[float]] = {"read": [], "identify": [], "make a row": [], "keep the row": []}
    with results_of(source, folder.parent / f"parts-{kind}", None, settings) as results:
        for item in items:
            with source.local(item) as path:
                marks = [time.process_time()]
                evidence = evidence_in(list(load(path)), **settings.options)
            marks.append(time.process_time())
            result = identify_evidence(evidence)
            marks.append(time.process_time())
            row = result_row(item, {}, result)
            marks.append(time.process_time())
            results.add(row)
            marks.append(time.process_time())
            for taken, part in zip(np.diff(marks), spent.values(), strict=True):
                part.append(1e3 * float(taken))
    return [
        Figure(what=f"{kind}: to {part} takes", value=statistics.median(times), unit="ms")
        for part, times in spent.items()
    ]


def _note(steps: list[float], now: object) -> None:
    steps.append(time.perf_counter())


def _read(path: Path) -> int:
    return len(load(path))


def _write(folder: Path, kind: str, serial: int, samples: int) -> Path:
    data = dataset(seed=serial, kind="prbs", samples=samples)
    path = folder / f"motor_{serial:05}.{kind}"
    columns = (("voltage", "V", data.u), ("angle", "rad", data.y))
    series = tuple(
        Series(channel=Channel(name=name, unit=unit), t=data.t_output, values=values)
        for name, unit, values in columns
    )
    save(Recording(name=path.stem, series=series, input="voltage", source=Source(name=path.stem)), path)
    return path


def _memory(folder: Path, few: int, many: int) -> list[Figure]:
    """Two fleets of links to one short file, as only the number matters."""
    folder.mkdir()
    one = _write(folder, "csv", 0, 300)
    peaks = []
    for count in (few, many):
        stand = folder / f"stand-{count}"
        stand.mkdir()
        for serial in range(count):
            os.link(one, stand / f"{serial:05}.csv")
        peaks.append(int(_run(stand, folder / f"out-{count}").strip()) / 1024)
    return [
        Figure(what=f"memory of {many} files over that of {few}", value=peaks[1] / peaks[0], unit="times", at_most=FLAT),
        Figure(what=f"memory of {many} files, the parent", value=peaks[1], unit="MB"),
    ]  # fmt: skip


def _run(stand: Path, out: Path) -> str:
    program = stand.parent / "run.py"
    program.write_text(_PROGRAM, encoding="utf-8")
    return subprocess.run(
        [sys.executable, str(program), str(stand), str(out)], check=True, capture_output=True, text=True
    ).stdout


def _kills(folder: Path, kills: int) -> list[Figure]:
    """Kill a command at random moments, resume it until it ends, and count rows."""
    stand, out = folder / "stand", folder / "out"
    stand.mkdir(parents=True)
    files = max(8, 3 * kills)
    for serial in range(files):
        _write(stand, "csv", serial, 500)
    program = folder / "run.py"
    program.write_text(_PROGRAM, encoding="utf-8")
    random = np.random.default_rng(20)
    running = 0
    for moment in random.uniform(1.0, 6.0, kills):
        process = subprocess.Popen(
            [sys.executable, str(program), str(stand), str(out)], stdout=subprocess.DEVNULL
        )
        try:
            process.wait(timeout=float(moment))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            running += 1
    _run(stand, out)
    names = [row["file"] for row in rows_in(out)]
    wanted = {path.name for path in stand.iterdir()}
    return [
        Figure(what=f"rows lost after {running} kills", value=len(wanted - set(names)), at_most=0),
        Figure(what=f"rows twice after {running} kills", value=len(names) - len(set(names)), at_most=0),
    ]


if __name__ == "__main__":
    asked = dict(zip(("files", "large", "kills"), map(int, sys.argv[1:]), strict=False))
    raise SystemExit(shown(main(Size(**asked))))

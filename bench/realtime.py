"""The loop's punctuality, against the kernel's own test (`cyclictest`) at the same time on another processor.

    python bench/realtime.py               a look of some seconds, for `make bench`
    python bench/realtime.py --write       6 pairs of 60 s of each condition; the table goes to docs/benchmarks/realtime.md
    python bench/realtime.py --write idle  one condition anew; the others' figures stay

The loop is the one of `servobench run`: its own process, the simulated motor beside the wall clock, the paper's experiment at
1 kHz, real-time scheduling. Its latency is the time from a tick's deadline to the latch of its sample, cyclictest's that from a
deadline to its wake-up. The two change processors from pair to pair. Real-time scheduling and at least two processors are
needed, and Debian's rt-tests and stress-ng.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from figures import Figure, shown

PAGE = Path(__file__).resolve().parent.parent / "docs" / "benchmarks" / "realtime.md"
SAMPLE_TIME = 0.001
QUANTILES = (0.5, 0.99, 0.999, 1.0)
NAMES = ("p50", "p99", "p99.9", "largest")
LONGEST = 100_000  # us that cyclictest's histogram holds
PAIRS, SECONDS = 6, 60
QUICK_PAIRS, QUICK_SECONDS = 2, 5


@dataclass(frozen=True)
class Condition:
    """The conditions of the loop: load on both processors, real-time scheduling or not, a reader of the rows."""

    name: str
    load: bool = False
    real_time: bool = True
    reader: bool = False


CONDITIONS = {
    "idle": Condition("idle"),
    "stress": Condition("stress-ng on all processors", load=True),
    "plain": Condition("idle, plain scheduler", real_time=False),
    "plain-stress": Condition("stress-ng, plain scheduler", load=True, real_time=False),
}
READER_NAME = "reader"
FIGURES = PAGE.with_suffix(".json")


@dataclass(frozen=True)
class Latency:
    """Quantiles of a latency [us], and how many ticks were missed, of how many."""

    quantiles: tuple[float, ...]
    missed: int
    ticks: int


def measured(seconds: float, cpu: int, condition: Condition) -> Latency:
    """Run the loop for some seconds and return its latency."""
    from servobench.rig.experiment import DeviceChoice, Experiment
    from servobench.rig.loop.process import LoopProcess

    twin = DeviceChoice(name="twin", settings={"timing": "host"})
    # Under the plain scheduler a loaded machine holds the loop up for longer than the watchdog would wait.
    asked = Experiment(
        duration=seconds, sample_time=SAMPLE_TIME, device=twin, limits={"watchdog": {"timeout": 0.5}}
    )
    with LoopProcess(asked, real_time=condition.real_time, cpu=cpu) as loop:
        names = [series.channel.name for series in loop.recording.series]
        reader, found = loop.rows(0), []
        with reading(loop.ring.name) if condition.reader else nothing():
            while loop.ended is None:
                time.sleep(0.2)
                found.append(reader.read(1 << 20))
        found.append(reader.read(1 << 20))
        if loop.ended.reason != "finished":
            print(f"the run ended early: {loop.ended.sentence}", file=sys.stderr)
    rows = np.concatenate(found)
    lateness = 1e6 * (rows[:, 0] - rows[:, 1 + names.index("scheduled")])
    missed = int(np.max(rows[:, 1 + names.index("scheduled")]) / SAMPLE_TIME + 1.5) - len(rows)
    if reader.missed:
        raise RuntimeError(f"the bench itself missed {reader.missed} rows")
    return Latency(tuple(np.quantile(lateness, QUANTILES)), missed, missed + len(rows))


class Cyclictest:
    """`cyclictest` on one processor for some seconds."""

    def __init__(self, seconds: float, cpu: int, real_time: bool) -> None:
        policy = ["--priority=80", "--policy=fifo"] if real_time else ["--policy=other"]
        self._process = subprocess.Popen(
            [
                "cyclictest", "--mlockall", "--quiet", "--threads=1", f"--affinity={cpu}", "--interval=1000",
                f"--duration={seconds:g}", f"--histogram={LONGEST}", *policy,
            ],
            stdout=subprocess.PIPE,
            text=True,
        )  # fmt: skip

    def latency(self) -> Latency:
        """Wait for its end and return its latency."""
        text, _ = self._process.communicate()
        counts = np.array([[int(a), int(b)] for a, b in re.findall(r"^(\d{6}) (\d+)", text, re.MULTILINE)])
        worst = int(re.search(r"# Max Latencies: (\d+)", text)[1])  # type: ignore[index]
        beyond = int(re.search(r"# Histogram Overflows: (\d+)", text)[1])  # type: ignore[index]
        us = np.append(counts[:, 0], worst)
        share = np.cumsum(np.append(counts[:, 1], beyond))
        quantiles = [float(us[np.searchsorted(share, q * share[-1])]) for q in QUANTILES[:-1]]
        over = int(share[-1] - share[int(1e6 * SAMPLE_TIME)])
        return Latency((*quantiles, float(worst)), over, int(share[-1]))


@contextmanager
def stressed(load: bool) -> Iterator[None]:
    """Keep all processors busy with `stress-ng` meanwhile."""
    process = subprocess.Popen(["stress-ng", "--cpu", str(os.cpu_count()), "--quiet"]) if load else None
    try:
        time.sleep(1.0 if load else 0.0)
        yield
    finally:
        if process is not None:
            process.terminate()
            process.wait()


@contextmanager
def nothing() -> Iterator[None]:
    """Do nothing meanwhile."""
    yield


READER = """
import json, sys
from servobench.rig.loop.ring import RowRing
with RowRing.attach(sys.argv[1]) as ring:
    reader = ring.reader(0)
    while True:
        json.dumps(reader.read().tolist())
"""


@contextmanager
def reading(ring: str) -> Iterator[None]:
    """Let a process read the rows and turn them into text, without a pause."""
    process = subprocess.Popen([sys.executable, "-c", READER, ring])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def pair(number: int, seconds: float, condition: Condition) -> tuple[Latency, Latency]:
    """The latencies of the loop and of cyclictest at the same time, each on its processor."""
    cpus = sorted(os.sched_getaffinity(0))[:2]
    ours, theirs = cpus if number % 2 else cpus[::-1]
    with stressed(condition.load):
        # It starts before the loop is up, and ends after it.
        limit = Cyclictest(seconds + 4, theirs, condition.real_time)
        loop = measured(seconds, ours, condition)
        return loop, limit.latency()


def with_and_without_reader(number: int, seconds: float) -> tuple[Latency, Latency]:
    """The latencies of the loop with a busy reader and without, one after the other, in turns."""
    cpu = sorted(os.sched_getaffinity(0))[number % 2]
    busy, alone = Condition("busy reader", reader=True), Condition("alone")
    if number // 2 % 2:
        without = measured(seconds, cpu, alone)
        return measured(seconds, cpu, busy), without
    return measured(seconds, cpu, busy), measured(seconds, cpu, alone)


def median_ratio(pairs: list[tuple[Latency, Latency]], quantile: int) -> float:
    """The median of the paired ratios of one quantile."""
    return float(np.median([a.quantiles[quantile] / b.quantiles[quantile] for a, b in pairs]))


def missing() -> str:
    """The reason why this machine can't run the comparison; empty if it can."""
    tools = [name for name in ("cyclictest", "stress-ng") if shutil.which(name) is None]
    if tools:
        return f"{' and '.join(tools)} not installed"
    return "" if len(os.sched_getaffinity(0)) > 1 else "only one processor"


def main(pairs_of_each: int = QUICK_PAIRS, seconds: float = QUICK_SECONDS) -> list[Figure]:
    """A look at idle and stressed, real-time scheduling, and at a busy reader."""
    if lacking := missing():
        print(f"realtime: {lacking}: nothing was measured", file=sys.stderr)
        return []
    figures = []
    for condition in (CONDITIONS["idle"], CONDITIONS["stress"]):
        pairs = [pair(k, seconds, condition) for k in range(pairs_of_each)]
        figures += limits(condition, pairs)
    readers = [with_and_without_reader(k, seconds) for k in range(pairs_of_each)]
    return [*figures, reader_limit(readers)]


def smallest() -> list[Figure]:
    """A look of one second at each; at the loop alone where the tools that it is compared with are missing."""
    if not missing():
        return main(1, 1)
    alone = measured(1.0, min(os.sched_getaffinity(0)), Condition("idle", real_time=False))
    return [Figure(what="latency of the loop alone: p50", value=alone.quantiles[0], unit="us")]


def limits(condition: Condition, pairs: list[tuple[Latency, Latency]]) -> list[Figure]:
    """The figures that have a limit: median and 99 % of the latency over cyclictest's."""
    what = f"loop / cyclictest at 1 kHz, {condition.name}"
    return [
        Figure(what=f"{what}: p50", value=median_ratio(pairs, 0), unit="times", at_most=0.1),
        Figure(what=f"{what}: p99", value=median_ratio(pairs, 1), unit="times", at_most=1.2),
    ]


def reader_limit(readers: list[tuple[Latency, Latency]]) -> Figure:
    """The figure of a busy reader."""
    return Figure(
        what="p99 of the loop with a busy reader / without",
        value=median_ratio(readers, 1),
        unit="times",
        at_most=1.5,
    )


def table(condition: Condition, pairs: list[tuple[Latency, Latency]], names: tuple[str, str]) -> list[str]:
    """The lines of one condition: the median of each quantile over the pairs, and of the paired ratios."""
    lines = [f"| {condition.name} | | {' | '.join(NAMES)} | missed |"]
    for place, name in enumerate(names):
        values = np.median([each[place].quantiles for each in pairs], axis=0)
        missed = sum(each[place].missed for each in pairs)
        ticks = sum(each[place].ticks for each in pairs)
        shown_values = " | ".join(f"{value:.3g}" for value in values)
        lines.append(f"| | {name} | {shown_values} | {missed} of {ticks} |")
    ratios = " | ".join(f"{median_ratio(pairs, k):.2g}" for k in range(len(NAMES)))
    return [*lines, f"| | median of the paired ratios | {ratios} | |"]


def write(names: list[str], pairs: int, seconds: float) -> list[Figure]:
    """Measure the conditions that are named, write the page of all, and return the figures with a limit."""
    kept = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {}
    for name in names or [*CONDITIONS, READER_NAME]:
        if name == READER_NAME:
            found = [with_and_without_reader(k, seconds) for k in range(pairs)]
        else:
            found = [pair(k, seconds, CONDITIONS[name]) for k in range(pairs)]
        kept[name] = {"pairs": [[asdict(a), asdict(b)] for a, b in found], "seconds": seconds}
        FIGURES.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    figures, lines = told(kept)
    PAGE.write_text(page(kept, lines), encoding="utf-8")
    return figures


def told(kept: dict[str, dict[str, Any]]) -> tuple[list[Figure], list[str]]:
    """The figures with a limit and the lines of the table, of what was measured."""
    figures: list[Figure] = []
    lines: list[str] = []
    for name, condition in CONDITIONS.items():
        if name in kept:
            found = [(latency(a), latency(b)) for a, b in kept[name]["pairs"]]
            lines += table(condition, found, ("loop", "cyclictest"))
            figures += limits(condition, found) if condition.real_time else []
    if READER_NAME in kept:
        found = [(latency(a), latency(b)) for a, b in kept[READER_NAME]["pairs"]]
        title = Condition("idle, a process that reads all rows without a pause")
        lines += table(title, found, ("with it", "without"))
        figures.append(reader_limit(found))
    return figures, lines


def latency(kept: dict[str, Any]) -> Latency:
    """A latency as it was kept."""
    return Latency(tuple(kept["quantiles"]), kept["missed"], kept["ticks"])


def page(kept: dict[str, dict[str, Any]], lines: list[str]) -> str:
    """The page of the table."""
    pairs = min(len(each["pairs"]) for each in kept.values())
    seconds = min(each["seconds"] for each in kept.values())
    release = Path("/proc/sys/kernel/osrelease").read_text(encoding="ascii").strip()
    head = "| condition | latency [µs] | | | | | |\n|---|---|---|---|---|---|---|"
    return f"""# Punctuality of the loop

Made by `python bench/realtime.py --write`: {pairs} pairs of {seconds:g} s or more of each condition, the loop and `cyclictest` at
the same time on two processors, which they change from pair to pair; Linux {release}, {os.cpu_count()} processors.
Medians over the pairs.

**The two don't measure the same.** The loop sleeps until shortly before the deadline of a tick and then *spins*: it
looks at the clock until the deadline is there, for 20 to 150 µs, which costs a part of a processor. cyclictest *sleeps*
until its deadline and is woken up by the kernel. So a loop that was woken up in time has next to no latency, and its
median says only how long one look at the clock takes; the ratio of the two medians is what spinning buys, not how much
faster the loop is. What can be compared is the tail: there both were woken up too late.

Latency of the loop is from the deadline of a tick to the *latch* of its sample: the moment, by the clock of the loop,
at which it asks the device for counts and current. What the device takes to answer comes on top of it, and isn't in
here: the device is the simulated motor. Latency of cyclictest is from its deadline to its wake-up. The largest values
describe the machine (a host that pauses a virtual processor, for instance), not either program. A tick of cyclictest
counts as missed where it woke up more than a period late.

{head}
{chr(10).join(lines)}
"""


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--write", nargs="*", metavar="CONDITION")
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--seconds", type=float, default=SECONDS)
    arguments = parser.parse_args()
    if arguments.write is None:
        sys.exit(shown(main()))
    sys.exit(shown(write(arguments.write, arguments.pairs, arguments.seconds)))

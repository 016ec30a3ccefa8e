"""The cost of one fit of each estimator: the paper's experiment on the twin, 5,000 samples, everything compiled.

Processor time of one core. Estimators are timed in turn with output_error, so that both meet the same load. The cost is
the median of the ratios within its pairs, times the median of all of output_error's times. Run by itself it writes
docs/benchmarks/cost.json, which docs/which-estimator.md quotes.
"""

import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy is imported

from figures import Figure, shown

import servobench as sb
from servobench.identification.estimators.base import ESTIMATORS, Estimator
from servobench.identification.models.base import STRUCTURES, Structure
from servobench.recordings.measurement.dataset import Dataset

FILE = Path(__file__).resolve().parent.parent / "docs" / "benchmarks" / "cost.json"
PAIRS = 15
LONGEST = 20.0  # s for one estimator: a slow one gets fewer pairs, but at least three
ANCHOR = "output_error"


STRUCTURES_OF_IT = ("first_order_one_way", "rational_1_0_integrator_delay")


def reference_data() -> tuple[Dataset, ...]:
    """Return the record as a position; as the paper's filtered speed; and as one with a reference, for who needs that.

    Here the loop is open, so the reference is what the input was.
    """
    experiment = sb.Experiment(signal=sb.Square(low=1.0, high=3.0, frequency=0.4), duration=10.0, seed=1)
    with sb.connect("twin") as motor:
        recording = sb.run(experiment, motor)
    position = sb.measure(recording)
    return (
        position,
        sb.measure(recording, "derivative | lowpass 50 rad/s"),
        replace(position, reference=position.u, reference_unit=position.input_unit),
    )


def tasks(data: tuple[Dataset, ...]) -> Iterator[tuple[str, Estimator, Structure, Dataset]]:
    """Return each estimator with the first data and structure that it supports; those that support none are left out."""
    for name in ESTIMATORS.names():
        estimator = ESTIMATORS[name]
        suited = [
            (STRUCTURES[structure], record)
            for record in data
            for structure in STRUCTURES_OF_IT
            if estimator.supports(STRUCTURES[structure], [record]) is None
        ]
        if suited:
            yield name, estimator, *suited[0]


def seconds(estimator: Estimator, structure: Structure, data: Dataset) -> float:
    """Return the processor time of one fit [s]; whoever else is at work on the machine doesn't count."""
    start = time.process_time()
    estimator.fit(structure, [data])
    return time.process_time() - start


def pairs(most: int = PAIRS) -> dict[str, list[tuple[float, float]]]:
    """Return, for each estimator, the times [s] of its fits, each beside that of a fit by output error just after it."""
    data = reference_data()
    anchor = (ESTIMATORS[ANCHOR], STRUCTURES["first_order_one_way"], data[0])
    seconds(*anchor)
    found = {}
    for name, *task in tasks(data):
        seconds(*task)  # compiles
        found[name], start = [], time.perf_counter()
        while len(found[name]) < min(3, most) or (
            len(found[name]) < most and time.perf_counter() - start < LONGEST
        ):
            found[name].append((seconds(*task), seconds(*anchor)))
    return found


def costs(found: dict[str, list[tuple[float, float]]]) -> dict[str, tuple[float, float, float]]:
    """Return the quartiles of each estimator's cost [s]."""
    anchor = statistics.median(other for each in found.values() for _, other in each)
    ratios = {name: [one / other for one, other in each] for name, each in found.items()}
    return {
        name: tuple(anchor * ratio for ratio in statistics.quantiles(each, n=4))
        for name, each in ratios.items()
    }


def figures(table: dict[str, tuple[float, float, float]]) -> list[Figure]:
    """Return the costs as figures; limits are the business of the bench of speed."""
    return [
        Figure(what=f"{name}, one fit", value=1e3 * middle, half=(1e3 * low, 1e3 * high), unit="ms")
        for name, (low, middle, high) in table.items()
    ]


def machine() -> str:
    """Return the processor and Python, as far as the system tells."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    processor = models[0] if models else platform.processor() or platform.machine()
    return f"one core of {processor}, Python {platform.python_version()}"


def write(table: dict[str, tuple[float, float, float]], file: Path = FILE) -> None:
    """Write the median costs [s], rounded to two digits, with date and machine."""
    file.parent.mkdir(parents=True, exist_ok=True)
    medians = {name: float(f"{middle:.1e}") for name, (_, middle, _) in table.items()}
    told = {**medians, "date": datetime.now(UTC).date().isoformat(), "machine": machine()}
    file.write_text(f"{json.dumps(told, indent=2)}\n", encoding="utf-8", newline="\n")


def main() -> list[Figure]:
    """Return the figures of this bench."""
    return figures(costs(pairs()))


def smallest() -> list[Figure]:
    """Return the figures of two pairs of each estimator."""
    return figures(costs(pairs(2)))


if __name__ == "__main__":
    measured = costs(pairs())
    write(measured)
    sys.exit(shown(figures(measured)))

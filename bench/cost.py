"""The cost of a fit: output error and all of `identify` on 5,000 samples, everything compiled, relative to SciPy's least
squares.

Processor time of one core. The peer gets the same guess, the same residual and the same exact Jacobian, through
`scipy.optimize.least_squares`; one of each in turn, so that both meet the same load, and the ratio is formed within each pair.
Each call gets a fresh copy of the data, so that nothing is remembered from the call before.

    python bench/cost.py          the times, and whether one is twice as long as its entries in bench/history.csv
    python bench/cost.py --keep   appends an entry for each
"""

import argparse
import os
import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy is imported
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the tests' reference motor

from figures import Figure, shown
from history import Timing, against_history, keep, milliseconds, timed

import servobench as sb
from servobench.identification.estimators.output_error import OutputError
from servobench.identification.estimators.prediction_error import PredictionError
from servobench.identification.models.base import STRUCTURES, Structure
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

FITS = 200
PAIRS = 30
IDENTIFICATIONS = 15


def by_scipy(structure: Structure, data: Dataset) -> object:
    """Fit as a user of SciPy would who has our prediction: the best from all our guesses, with the exact Jacobian."""
    from scipy.optimize import least_squares

    found = [
        least_squares(
            lambda theta: structure.predict(theta, data).y - data.y,
            guess,
            lambda theta: structure.predict(theta, data).jacobian,
            x_scale="jac",
        )
        for guess in structure.guesses([data])
    ]
    return min(found, key=lambda result: float(result.cost))


def against_scipy(what: str, structure: Structure, data: Dataset, pairs: int) -> Figure:
    """Return how many times as long SciPy's search takes as our fit, intervals included."""
    by_scipy(structure, data)
    ratios = []
    for _ in range(pairs):
        ours = milliseconds(lambda: OutputError().fit(structure, [replace(data)]))
        ratios.append(milliseconds(lambda: by_scipy(structure, replace(data))) / ours)
    low, middle, high = statistics.quantiles(ratios, n=4)
    return Figure(
        what=f"{what}: SciPy's search, against fit and intervals",
        value=middle,
        half=(low, high),
        unit="times",
        at_least=1.0,
    )


@dataclass(frozen=True, kw_only=True)
class Timed:
    """A call that is timed so many times, and its limit and goal [ms]."""

    what: str
    call: Callable[[], object]
    times: int
    at_most: float
    goal: str = ""

    def figure(self, timing: Timing) -> Figure:
        """Return what it took."""
        low, middle, high = timing.quartiles
        limits = {"at_most": self.at_most, "goal": self.goal}
        return Figure(what=self.what, value=middle, half=(low, high), unit="ms", **limits)


def _rows() -> tuple[tuple[str, Structure, Dataset], ...]:
    """The two records: what they are, the structure that suits them, and the data."""
    return (
        ("one way, 6 parameters", STRUCTURES["first_order_one_way"], dataset(seed=1)),
        ("friction, 7 parameters", STRUCTURES["first_order_coulomb"], dataset(seed=1, kind="prbs")),
    )


def calls() -> list[Timed]:
    """Return all that is timed by itself."""
    limits = {"one way, 6 parameters": (1.5, 30.0), "friction, 7 parameters": (5.0, 50.0)}
    found = []
    for what, structure, data in _rows():
        fit, whole = limits[what]
        found += [
            Timed(
                what=f"output error, {what}",
                call=partial(_fitted, structure, data),
                times=FITS,
                at_most=fit,
                goal="below 1.5",
            ),
            Timed(
                what=f"identify, {what}",
                call=partial(_identified, data),
                times=IDENTIFICATIONS,
                at_most=whole,
            ),
        ]
    disturbed = dataset(seed=1, torque_noise=1e-5)
    start = OutputError().fit(STRUCTURES["first_order_one_way"], [disturbed])
    after = Timed(
        what="prediction error after output error, torque 1e-5 N·m/√Hz",
        call=partial(PredictionError().fit_after, start),
        times=FITS // 4,
        at_most=60.0,
        goal="below 20",
    )
    return [*found, after]


def _fitted(structure: Structure, data: Dataset) -> object:
    return OutputError().fit(structure, [replace(data)])


def _identified(data: Dataset) -> object:
    return sb.identify(replace(data))


def main(least: int | None = None) -> list[Figure]:
    """Return the figures of this bench; `least` is how often each call is timed, as often as it needs without it."""
    tasks = calls()
    timings = {task.what: timed(task.call, least or task.times) for task in tasks}
    peers = [against_scipy(what, structure, data, least or PAIRS) for what, structure, data in _rows()]
    return [*(task.figure(timings[task.what]) for task in tasks), *peers, *against_history(timings)]


def smallest() -> list[Figure]:
    """Return the figures of two calls each."""
    return main(2)


def command(words: list[str]) -> int:
    """Show the figures, or append an entry to the history."""
    parser = argparse.ArgumentParser(description="What a fit costs.")
    parser.add_argument("--keep", action="store_true", help="append an entry to bench/history.csv")
    if not parser.parse_args(words).keep:
        return shown(main())
    keep({task.what: timed(task.call, task.times) for task in calls()})
    return 0


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))

"""What a fit costs: output error and the whole of `identify` on 5,000 samples, everything compiled, beside SciPy's least squares.

Processor time of one core. The peer gets the same guess, the same residual and the same exact Jacobian, through
`scipy.optimize.least_squares`; one of each in turn, so that both meet the same load, and the ratio is formed within each pair.
Each call gets a fresh copy of the data, so that nothing is remembered from the call before.
"""

import os
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy is imported
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the tests' reference motor

from figures import Figure, shown

import servobench as sb
from servobench.estimators.output_error import OutputError
from servobench.estimators.prediction_error import PredictionError
from servobench.measurement.dataset import Dataset
from servobench.models.base import STRUCTURES, Structure
from tests.datasets import dataset

FITS = 200
PAIRS = 30
IDENTIFICATIONS = 15


def milliseconds(call: Callable[[], object]) -> float:
    """Return the processor time that a call takes [ms]."""
    start = time.process_time()
    call()
    return 1e3 * (time.process_time() - start)


def repeated(
    what: str, call: Callable[[], object], times: int, *, at_most: float | None, goal: str = ""
) -> Figure:
    """Return how long a call takes [ms], the first one left out."""
    call()
    low, middle, high = statistics.quantiles([milliseconds(call) for _ in range(times)], n=4)
    return Figure(what=what, value=middle, half=(low, high), unit="ms", at_most=at_most, goal=goal)


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


def against_scipy(what: str, structure: Structure, data: Dataset) -> Figure:
    """Return how many times as long SciPy's search takes as our fit, intervals included."""
    by_scipy(structure, data)
    ratios = []
    for _ in range(PAIRS):
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


def main() -> list[Figure]:
    """Return the figures of this bench."""
    rows = (
        ("one way, 6 parameters", "first_order_one_way", dataset(seed=1), 3.0, "below 1"),
        ("friction, 7 parameters", "first_order_coulomb", dataset(seed=1, kind="prbs"), 8.0, "below 2"),
    )
    figures = []
    for what, name, data, limit, goal in rows:
        structure = STRUCTURES[name]

        def fit(structure: Structure = structure, data: Dataset = data) -> object:
            return OutputError().fit(structure, [replace(data)])

        def everything(data: Dataset = data) -> object:
            return sb.identify(replace(data))

        figures += [
            repeated(f"output error, {what}", fit, FITS, at_most=limit, goal=goal),
            against_scipy(what, structure, data),
            repeated(f"identify, {what}", everything, IDENTIFICATIONS, at_most=300.0),
        ]
    disturbed = dataset(seed=1, torque_noise=1e-5)
    start = OutputError().fit(STRUCTURES["first_order_one_way"], [disturbed])
    figures.append(
        repeated(
            "prediction error after output error, torque 1e-5 N·m/√Hz",
            lambda: PredictionError().fit_after(start),
            FITS // 4,
            at_most=60.0,
            goal="below 20",
        )
    )
    return figures


if __name__ == "__main__":
    sys.exit(shown(main()))

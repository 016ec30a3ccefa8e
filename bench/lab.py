"""The time of `servobench lab page`: every exercise done, its pages written, all kernels compiled before.

Whole processes, so that starting the interpreter counts, too. Beside the total there is the slowest exercise, each done alone in
this process: it is the one to look at where the limit comes near.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from figures import Figure, shown

from servobench.lab.exercise import Exercise
from servobench.lab.exercise_file import exercises
from servobench.lab.page import exercise_page
from servobench.lab.stand import stand_with
from servobench.lab.worked_exercise import WorkedExercise

RUNS = 3
LIMIT = 60.0  # s


def seconds(folder: Path) -> float:
    """Return how long a process takes that writes all exercises into a folder [s]."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "servobench", "lab", "page", "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def alone(which: Sequence[Exercise]) -> dict[str, float]:
    """Return how long each exercise takes by itself, with its page [s]."""
    taken = {}
    for exercise in which:
        start = time.perf_counter()
        stand = stand_with(exercise, exercise.experiment.device)  # a new one, which remembers nothing
        exercise_page(WorkedExercise(exercise=exercise, stand=stand, given={}), solution=True)
        taken[exercise.name] = time.perf_counter() - start
    return taken


def main() -> list[Figure]:
    """Return the figures of this bench."""
    with tempfile.TemporaryDirectory() as place:
        seconds(Path(place) / "first")  # once for the kernels
        times = [seconds(Path(place) / str(number)) for number in range(RUNS)]
        pages = sum(1 for _ in (Path(place) / "first").glob("*.html"))
    taken = alone(exercises())
    slowest = max(taken, key=lambda name: taken[name])
    return [
        Figure(
            what=f"servobench lab page, {len(taken)} exercises, {pages} pages",
            value=statistics.median(times),
            half=(min(times), max(times)),
            unit="s",
            at_most=LIMIT,
        ),
        Figure(what=f"the slowest exercise, {slowest}", value=taken[slowest], unit="s", goal="below 3"),
    ]


def smallest() -> list[Figure]:
    """Return how long the first exercise takes by itself."""
    return [
        Figure(what=f"exercise {name}", value=taken, unit="s")
        for name, taken in alone(exercises()[:1]).items()
    ]


if __name__ == "__main__":
    sys.exit(shown(main()))

"""The speed of identification: one pass of a predictor against C, its fit against SciPy, and all of `identify`.

Processor time of one core; one of each in turn, so that both meet the same load, and the ratio is formed within each pair. The C
is bench/speed_parts/predictor.c, compiled here by `gcc -O3 -march=native`, with its pointers made beforehand. The predictor is
that of `servobench.identification.models.from_rest`, for 5,000 samples of an encoder: gain, time constant and start position.
SciPy gets its residual from `lfilter` or `lsim`, and no derivatives, as somebody writes it who has no predictor of ours.
What output error and prediction error cost by themselves is bench/cost.py.

    python bench/identification_speed.py           the figures
    python bench/identification_speed.py --write   docs/benchmarks/identification-speed.md, those of bench/cost.py included
"""

from __future__ import annotations

import argparse
import ctypes
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy is imported
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the tests' reference motor

import numpy as np
from figures import Figure, shown
from history import milliseconds

import servobench as sb
from servobench.core.channels import Array
from servobench.identification.models.from_rest import fit_from_rest, normal_equations
from tests.datasets import dataset

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parent / "docs" / "benchmarks" / "identification-speed.md"
STEP = 0.002  # s
TRUE = np.array([1 / 0.042, 0.09977, 0.0])  # rad/(s·V), s, rad
START = np.array([20.0, 0.13, 0.0])
QUANTUM = 2 * np.pi / 2048  # rad
MOST = 30  # steps of a fit
CALLS = 20  # of something too short for the processor's clock, for one time


@dataclass(frozen=True)
class Size:
    """The size of the measurement."""

    samples: int
    pairs: int
    identifications: int


FULL = Size(samples=5_000, pairs=40, identifications=15)
SMALLEST = Size(samples=1_000, pairs=2, identifications=2)


class InC:
    """The predictor in C, for one record; both functions have the arguments of those in Python."""

    def __init__(self, folder: Path, u: Array, y: Array, p: Array) -> None:
        library = folder / "predictor.so"
        made = ["gcc", "-O3", "-march=native", "-shared", "-fPIC", "-o", str(library)]
        subprocess.run([*made, str(FOLDER / "speed_parts" / "predictor.c"), "-lm"], check=True)
        self.h, self.g, self._kept = np.empty((3, 3)), np.empty(3), (u, y, p)
        pointers = [ctypes.c_void_p(each.ctypes.data) for each in (u, y, p, self.h, self.g)]
        record = (*pointers[:2], ctypes.c_double(STEP), ctypes.c_int64(len(y)))
        self._evaluation, self._fit = (*record, *pointers[2:]), (*record, pointers[2], ctypes.c_int64(MOST))
        self._library = ctypes.CDLL(str(library))
        self._library.normal_equations.restype = ctypes.c_double
        self._library.fit_from_rest.restype = ctypes.c_int64

    def normal_equations(self) -> float:
        return float(self._library.normal_equations(*self._evaluation))

    def fit_from_rest(self) -> int:
        return int(self._library.fit_from_rest(*self._fit))


def voltage(samples: int) -> Array:
    """Return a voltage that reverses the motor a few times a second [V]."""
    t = STEP * np.arange(samples)
    return np.clip(3.0 * np.sign(np.sin(2 * np.pi * 0.4 * t)) + 9.0 * np.sin(2 * np.pi * 1.1 * t), -10, 10)


def position(p: Array, u: Array) -> Array:
    """Return the position (M,) [rad] by SciPy's filter of one pole, and the exact integral of its speed."""
    from scipy.signal import lfilter

    gain, tau, start = p
    a = np.exp(-STEP / tau)
    speed = lfilter([0.0, gain * (1 - a)], [1.0, -a], u)
    driven = np.concatenate([[0.0], np.cumsum(gain * u[:-1])])
    return np.asarray(start + STEP * driven - tau * speed)


def by_lsim(p: Array, u: Array) -> Array:
    """Return the same by SciPy's simulation of a system in continuous time with a held input."""
    from scipy.signal import StateSpace, lsim

    gain, tau, start = p
    system = StateSpace([[-1 / tau, 0.0], [1.0, 0.0]], [[gain / tau], [0.0]], [[0.0, 1.0]], [[0.0]])
    return np.asarray(start + lsim(system, u, STEP * np.arange(len(u)), interp=False)[1])


def by_scipy(simulated: Callable[[Array, Array], Array], u: Array, y: Array) -> Array:
    """Return the three parameters by SciPy's search with differences, each about as long as its own size."""
    from scipy.optimize import least_squares

    return np.asarray(least_squares(lambda p: simulated(p, u) - y, START, x_scale=(20.0, 0.1, 1.0)).x)


def by_filters(p: Array, u: Array, y: Array) -> tuple[Array, Array, float]:
    """Return the normal equations as a user of NumPy forms them: residual and Jacobian by filters, then products."""
    from scipy.signal import lfilter

    gain, tau, start = p
    a = np.exp(-STEP / tau)
    speed = lfilter([0.0, 1 - a], [1.0, -a], u)
    by_tau = lfilter([0.0, a * STEP / tau**2], [1.0, -a], speed - u)
    unit = STEP * np.concatenate([[0.0], np.cumsum(u[:-1])]) - tau * speed
    jacobian = np.column_stack([unit, gain * (-speed - tau * by_tau), np.ones(len(y))])
    r = y - start - gain * unit
    return jacobian.T @ jacobian, jacobian.T @ r, float(r @ r)


def microseconds(what: str, call: Callable[[], object], pairs: int, **limits: object) -> Figure:
    """Return what a short call takes."""
    call()
    times = [1e3 * milliseconds(partial(repeat, call)) / CALLS for _ in range(pairs)]
    return figure(what, times, "us", **limits)


def ratio(
    what: str, one: Callable[[], object], other: Callable[[], object], pairs: int, **limits: object
) -> Figure:
    """Return how many times as long the one call takes as the other."""
    one()
    other()
    return figure(what, [milliseconds(one) / milliseconds(other) for _ in range(pairs)], "times", **limits)


def figure(what: str, found: list[float], unit: str, **limits: object) -> Figure:
    """Return the quartiles of what was found as a figure."""
    low, middle, high = statistics.quantiles(found, n=4)
    return Figure(what=what, value=middle, half=(low, high), unit=unit, **limits)


def repeat(call: Callable[[], object]) -> None:
    """Call so often that the processor's clock can tell."""
    for _ in range(CALLS):
        call()


def against_c_and_scipy(size: Size, folder: Path) -> Iterator[Figure]:
    """Return the predictor and its fit against C and SciPy, and by how much what they find differs."""
    u = voltage(size.samples)
    y = (np.floor(position(TRUE, u) / QUANTUM) + 0.5) * QUANTUM
    p, h, g = START.copy(), np.empty((3, 3)), np.empty(3)
    in_c = InC(folder, u, y, p)

    def evaluate() -> float:
        return normal_equations(u, y, STEP, p, h, g)

    def fit() -> int:
        p[:] = START
        return fit_from_rest(u, y, STEP, p, MOST)

    def fit_in_c() -> int:
        p[:] = START
        return in_c.fit_from_rest()

    what = f"{size.samples} samples"
    yield microseconds(f"predictor with sensitivities, {what}", evaluate, size.pairs)
    yield ratio(
        "the same, over C",
        partial(repeat, evaluate),
        partial(repeat, in_c.normal_equations),
        size.pairs,
        goal="at most 1.1",
    )
    plain, theirs = partial(by_filters, START, u, y), partial(repeat, evaluate)
    yield per_call(ratio("lfilter and NumPy, over the predictor", plain, theirs, size.pairs, goal="above 10"))
    yield microseconds(f"three-parameter fit from rest, {what}", fit, size.pairs, goal="at most 80")
    yield ratio("the same, over C", partial(repeat, fit), partial(repeat, fit_in_c), size.pairs)
    for name, simulated, pairs in (
        ("lfilter", position, size.pairs // 2),
        ("lsim", by_lsim, size.pairs // 8),
    ):
        what = f"SciPy least_squares with differences of {name}, over the fit"
        theirs = partial(by_scipy, simulated, u, y)
        yield per_call(ratio(what, theirs, partial(repeat, fit), max(pairs, 2), goal="above 100"))
    fit()
    ours = p.copy()
    apart = np.abs(by_scipy(position, u, y) - ours) / standard_deviations(ours, u, y)
    yield Figure(what="SciPy's fit and ours differ by", value=float(apart.max()), unit="sd", at_most=1e-2)
    p[:] = START
    evaluate()
    in_c.normal_equations()
    differ = float(np.abs(h / in_c.h - 1.0).max())
    yield Figure(what="normal equations differ from C by", value=differ, unit="relative", at_most=1e-10)


def standard_deviations(p: Array, u: Array, y: Array) -> Array:
    """Return those of the three parameters (3,)."""
    h, _, cost = by_filters(p, u, y)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(h)) * cost / len(y)))


def per_call(found: Figure) -> Figure:
    """Return a ratio to repeated calls as that to one."""
    low, high = found.half or (found.value, found.value)
    return replace(found, value=CALLS * found.value, half=(CALLS * low, CALLS * high))


def identifications(size: Size) -> Iterator[Figure]:
    """Return what an identification costs, everything on, of recordings that are loaded, each time of a fresh copy."""
    experiment = sb.Experiment(duration=size.samples * STEP)
    records: dict[str, object] = {}
    for what, torque in (("the paper's experiment", 0.0), ("the same under a random torque", 1e-6)):
        with sb.connect("twin", torque_noise=torque) as twin:
            records[what] = sb.run(experiment, twin)
    records["a random binary input, both ways"] = dataset(seed=1, kind="prbs", samples=size.samples)
    for what, record in records.items():
        sb.identify(replace(record))
        times = [milliseconds(partial(sb.identify, replace(record))) for _ in range(size.identifications)]
        yield figure(f"identify(auto), {what}, {size.samples} samples", times, "ms", goal="at most 20")


def main(size: Size = FULL) -> list[Figure]:
    """Return the figures of this bench; without a compiler those of identifications alone."""
    if shutil.which("gcc") is None:
        print("identification_speed: gcc isn't installed: nothing was compared with C", file=sys.stderr)
        return list(identifications(size))
    with tempfile.TemporaryDirectory() as folder:
        return [*against_c_and_scipy(size, Path(folder)), *identifications(size)]


def smallest() -> list[Figure]:
    """Return the figures of few samples and calls."""
    return main(SMALLEST)


def page(figures: list[Figure]) -> str:
    """Return the page that shows the figures."""
    import numba
    import scipy

    rows = [
        f"| {each.what} | {each.value:.4g} {each.unit} | {half(each)} | {each.limit} |" for each in figures
    ]
    machine = f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()} {platform.release()}"
    versions = f"servobench {sb.__version__}, Python {platform.python_version()}, NumPy {np.__version__}"
    return "\n".join(
        [
            "# Speed of identification",
            "",
            f"Made by `python bench/identification_speed.py --write` on {datetime.now(UTC).date()}: {machine}; {versions}, "
            f"SciPy {scipy.__version__}, Numba {numba.__version__}.",
            "",
            "Processor time of one core, medians and the middle half; ratios are formed within pairs measured in turn.",
            "The predictor simulates an encoder's position from gain, time constant and start position, with its derivatives,",
            "and adds up the normal equations in one pass. C does the same, compiled with `gcc -O3 -march=native`.",
            "SciPy's search takes its derivatives from differences, once with the motor as a discrete filter (`lfilter`), once",
            "as a system in continuous time (`lsim`).",
            "`identify(auto)` chooses structure and noise model, tests for twenty-five missing terms, validates on parts that",
            "are left out, and looks for what may be wrong with the record.",
            "",
            "| what | median | half of all | limit, goal |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


def half(each: Figure) -> str:
    """Return the range of a figure's middle half, empty where it has none."""
    return f"{each.half[0]:.4g} to {each.half[1]:.4g}" if each.half else ""


def command(words: list[str]) -> int:
    """Show the figures, and write the page if that is requested."""
    parser = argparse.ArgumentParser(description="How near identification comes to the machine.")
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks/identification-speed.md")
    asked, figures = parser.parse_args(words), main()
    if asked.write:
        import cost

        PAGE.write_text(
            page([*figures, *(each for each in cost.main() if "over " not in each.what)]), encoding="utf-8"
        )
    return shown(figures)


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))

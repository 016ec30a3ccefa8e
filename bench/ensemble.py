"""The cost of a tick of one motor of an ensemble, against the same in C, by NumPy over the motors, and by JAX.

Processor time; one of each in turn, so that both meet the same load; the ratio is formed within each pair, and medians and
quartiles are those of the ratios. Two threads against one are wall time, each pinned to a processor; the best of all tries
counts, as on shared processors the others tell the machine's load. The C is bench/ensemble_parts/lanes.c, compiled here by
`gcc -O3 -march=native -ffast-math`, by hand in registers where the processor has AVX-512.

    python bench/ensemble.py           the figures
    python bench/ensemble.py --write   docs/benchmarks/ensemble.md
    python bench/ensemble.py --peers PYTHON   with JAX of that environment, which bench/peers/run.py makes
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
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy is imported

import numpy as np
from figures import Figure, shown

import servobench as sb
from servobench.core.channels import Array
from servobench.rig.devices.twin import TwinSettings
from servobench.rig.ensemble import kernels
from servobench.rig.ensemble.lanes import LANES
from servobench.rig.ensemble.motors import Motors
from servobench.rig.ensemble.tolerances import draw_motors, tolerances_of
from servobench.systems.control.pid import Pid

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parent / "docs" / "benchmarks" / "ensemble.md"
PEERS = FOLDER / "peers" / "data" / "env-requirements" / "bin" / "python"
STEP = 0.002  # s
SPREAD = dict.fromkeys(("resistance", "motor_constant", "inertia", "coulomb_torque", "inductance"), "10%")
TORQUE_NOISE = 2e-5  # N·m/√Hz


@dataclass(frozen=True)
class Size:
    """The size of the measurement."""

    motors: int
    ticks: int
    pairs: int
    slow_pairs: int
    tries: int


FULL = Size(motors=10_048, ticks=5_000, pairs=15, slow_pairs=3, tries=20)
SMALLEST = Size(motors=48, ticks=200, pairs=2, slow_pairs=2, tries=2)


class Work:
    """An ensemble that is ready to be simulated: by us, in C and by NumPy."""

    def __init__(self, size: Size, folder: Path) -> None:
        twin = TwinSettings()
        self.motors = Motors(parameters=draw_motors(twin, tolerances_of(twin, SPREAD), size.motors, seed=1))
        self.c = self.set_up()
        t = STEP * np.arange(size.ticks)
        self.u = 3.0 * np.sign(np.sin(2 * np.pi * 0.4 * t)) + 9.0 * np.sin(2 * np.pi * 1.1 * t)
        padded = self.c.shape[1]
        self.blocks, self.looks = padded // LANES, np.array([size.ticks])
        self.states = np.empty((3, 1, padded))
        self.counts = np.zeros((self.blocks, size.ticks, LANES), np.int16)
        self.counts_in_c, self.states_in_c = np.zeros_like(self.counts), np.empty((3, padded))
        self.keys = np.empty(padded, np.uint64)
        kernels.keys_of(np.uint64(1), self.keys)
        library = folder / "lanes.so"
        made = ["gcc", "-O3", "-march=native", "-ffast-math", "-shared", "-fPIC", "-o", str(library)]
        subprocess.run([*made, str(FOLDER / "ensemble_parts" / "lanes.c"), "-lm"], check=True)
        self._library = ctypes.CDLL(str(library))
        self.by_hand = bool(ctypes.c_int.in_dll(self._library, "registers_by_hand").value)
        self._numbers = tuple(map(ctypes.c_int64, (size.ticks, padded)))
        self._arrays = tuple(
            ctypes.c_void_p(each.ctypes.data) for each in (self.c, self.u, self.states_in_c, self.counts_in_c)
        )

    def set_up(self) -> Array:
        """The coefficients of all motors."""
        return self.motors.coefficients(STEP, TORQUE_NOISE, 2048.0)

    def ours(
        self, *, counts: bool = True, noise: bool = False, first: int = 0, last: int | None = None
    ) -> None:
        kernels.drive(
            self.c, self.u, self.looks, self.states, self.counts if counts else None, self.keys if noise else None, 0.0,
            first, self.blocks if last is None else last,
        )  # fmt: skip

    def in_c(self, *, counts: bool = True, first: int = 0, last: int | None = None) -> None:
        c, u, state, kept = self._arrays
        blocks = map(ctypes.c_int64, (first, self.blocks if last is None else last))
        call = self._library.with_counts if counts else self._library.states_only
        call(c, u, *self._numbers, *blocks, state, kept)

    def by_numpy(self) -> Array:
        """All motors at a time, tick by tick."""
        a00, a01, b0, a10, a11, b1, t0, t1, tb, c1, g, q, limit, scale = self.c[: kernels.SHOCK]
        i, w, theta = np.zeros((3, self.c.shape[1]))
        counts = np.empty((len(self.u), self.c.shape[1]), np.int16)
        for tick, given in enumerate(self.u):
            counts[tick] = np.floor(theta * scale).astype(np.int32)
            v = np.clip(given, -limit, limit)
            free = a10 * i + a11 * w + b1 * v
            d = np.clip(free, -c1, c1)
            theta += (t0 * i + tb * v) + (t1 * w - q * d)
            i = a00 * i + a01 * w + b0 * v + g * d
            w = free - d
        return counts


def processor_time(call: Callable[[], object]) -> float:
    """Return the processor time that a call takes [s]."""
    start = time.process_time()
    call()
    return time.process_time() - start


def quartiles(what: str, found: list[float], unit: str, **limits: object) -> Figure:
    """Return the median and the quartiles of what was found."""
    low, middle, high = statistics.quantiles(found, n=4)
    return Figure(what=what, value=middle, half=(low, high), unit=unit, **limits)  # type: ignore[arg-type]


def ratio(
    what: str, theirs: Callable[[], float], ours: Callable[[], float], pairs: int, **limits: object
) -> Figure:
    """Return how many times as long the one takes as the other; both return their time [s]."""
    theirs()
    ours()
    return quartiles(what, [theirs() / ours() for _ in range(pairs)], "times", **limits)


def against_c(work: Work, size: Size) -> list[Figure]:
    """Return a motor's tick by us and in C, and how far the two are apart."""
    steps = size.motors * size.ticks
    found = []
    for kind, counts in (("counts stored", True), ("final states only", False)):
        ours, theirs = partial(work.ours, counts=counts), partial(work.in_c, counts=counts)
        ours()
        theirs()
        for who, call in (("the ensemble's kernel", ours), ("C", theirs)):
            times = [1e9 * processor_time(call) / steps for _ in range(size.pairs)]
            found.append(quartiles(f"{who}, a motor's tick, {kind}", times, "ns"))
        goal = {"goal": "1.25"} if counts else {}
        found.append(
            ratio(
                f"the ensemble's kernel over C, {kind}",
                partial(processor_time, ours),
                partial(processor_time, theirs),
                size.pairs,
                **goal,
            )
        )
    apart = float(np.abs(work.states[1, 0] - work.states_in_c[1]).max())
    other = int((work.counts != work.counts_in_c).sum())
    return [
        *found,
        Figure(what="speed at the end, kernel and C differ by", value=apart, unit="rad/s", at_most=1e-9),
        Figure(what="counts that differ between kernel and C", value=float(other), unit="", at_most=0.0),
    ]


def against_arrays(work: Work, size: Size, peers: Path) -> list[Figure]:
    """Return how many times as long NumPy and JAX take."""
    ours = partial(processor_time, work.ours)
    what = "over the ensemble's kernel, counts stored"
    found = [
        ratio(
            f"NumPy over the motors, {what}",
            partial(processor_time, work.by_numpy),
            ours,
            size.slow_pairs,
            goal="15",
        )
    ]
    with by_jax(work, peers) as call:
        if call is not None:
            found.append(ratio(f"JAX vmap, {what}", call, ours, size.slow_pairs, goal="15"))
    return found


@contextmanager
def by_jax(work: Work, python: Path) -> Iterator[Callable[[], float] | None]:
    """Return a call that lets JAX simulate all motors and returns its processor time [s]; None where it isn't installed."""
    if not python.exists():
        yield None
        return
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "given.npz"
        np.savez(file, c=work.c[: kernels.SHOCK], u=work.u)
        environment = os.environ | {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}
        words = [str(python), "-c", "import sys, by_jax; by_jax.main(sys.argv[1])", str(file)]
        with subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=FOLDER / "ensemble_parts",
        ) as process:

            def call() -> float:
                assert process.stdin is not None
                assert process.stdout is not None
                print("go", file=process.stdin, flush=True)
                return float(process.stdout.readline())

            yield call


def by_threads(work: Work, size: Size) -> list[Figure]:
    """Return how many times as fast two threads are as one: the best of all tries, on a processor each."""
    if not hasattr(os, "sched_setaffinity") or len(os.sched_getaffinity(0)) < 2:
        return []
    cores = sorted(os.sched_getaffinity(0))
    middle = work.blocks // 2
    with ThreadPoolExecutor(2) as pool:

        def wall(shares: list[tuple[int, int]], call: Callable[..., None]) -> float:
            start = time.perf_counter()
            futures = [
                pool.submit(pinned, core, partial(call, first=first, last=last))
                for core, (first, last) in zip(cores, shares, strict=False)
            ]
            for future in futures:
                future.result()
            return time.perf_counter() - start

        found = []
        for who, call in (("", work.ours), (" of the C", work.in_c)):
            one, two = [(0, work.blocks)], [(0, middle), (middle, work.blocks)]
            tries = [(wall(one, call), wall(two, call)) for _ in range(size.tries)]
            gain = min(t for t, _ in tries) / min(t for _, t in tries)
            goal = "" if who else "1.8"
            found.append(
                Figure(
                    what=f"two threads{who} against one, best of {size.tries}",
                    value=gain,
                    unit="times",
                    goal=goal,
                )
            )
    return found


def pinned(core: int, call: Callable[[], None]) -> None:
    """Call with this thread on one processor."""
    os.sched_setaffinity(0, {core})
    call()


def beside(work: Work, size: Size) -> list[Figure]:
    """Return what comes beside the simulation: the set-up, a random torque, bands and sensitivities, a controller."""
    share = ratio(
        "set-up of all motors, a part of the simulation",
        partial(processor_time, work.set_up),
        partial(processor_time, work.ours),
        size.pairs,
        goal="0.05",
    )
    plain = sb.Experiment(signal=sb.Sine(amplitude=9.0, frequency=1.1), duration=size.ticks * STEP)
    loop = plain.model_copy(
        update={
            "signal": sb.Square(low=0.0, high=1.0, frequency=0.4),
            "controller": Pid(kp=3.0, ki=1.0, kd=0.06),
        }
    )
    fewer = max(size.motors // 20, 1)
    calls: dict[str, tuple[Callable[[], object], int]] = {
        "with a random torque": (partial(work.ours, noise=True), size.motors),
        "sb.ensemble with bands and sensitivities": (
            lambda: sb.ensemble("qube_servo_2", plain, size.motors, SPREAD, threads=1),
            size.motors,
        ),
        f"the same under PID, {fewer:,} motors": (
            lambda: sb.ensemble("qube_servo_2", loop, fewer, SPREAD, threads=1),
            fewer,
        ),
    }
    found = []
    for what, (call, motors) in calls.items():
        call()
        times = [1e9 * processor_time(call) / (motors * size.ticks) for _ in range(size.slow_pairs)]
        found.append(quartiles(f"{what}, a motor's tick", times, "ns"))
    return [share, *found]


def main(size: Size = FULL, peers: Path = PEERS) -> list[Figure]:
    """Return the figures of this bench; none where there is no compiler to compare with."""
    if shutil.which("gcc") is None:
        print("ensemble: gcc isn't installed: nothing was measured", file=sys.stderr)
        return []
    with tempfile.TemporaryDirectory() as folder:
        work = Work(size, Path(folder))
        return [
            *against_c(work, size),
            *against_arrays(work, size, peers),
            *by_threads(work, size),
            *beside(work, size),
        ]


def smallest() -> list[Figure]:
    """Return the figures of few motors."""
    return main(SMALLEST)


def page(figures: list[Figure], peers: Path) -> str:
    """Return the page that shows the figures."""
    import numba

    compiler = subprocess.run(
        ["gcc", "--version"], capture_output=True, text=True, check=True
    ).stdout.splitlines()[0]
    rows = [
        f"| {each.what} | {each.value:.3g} {each.unit} | {each.half[0]:.3g} to {each.half[1]:.3g} | {each.limit} |"
        if each.half
        else f"| {each.what} | {each.value:.3g} {each.unit} | | {each.limit} |"
        for each in figures
    ]
    busy = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    machine = f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()} {platform.release()}"
    versions = f"servobench {sb.__version__}, Python {platform.python_version()}, NumPy {np.__version__}, "
    return "\n".join(
        [
            "# Speed of an ensemble",
            "",
            f"Made by `python bench/ensemble.py --write` on {datetime.now(UTC).date()}: {machine}; {versions}Numba "
            f"{numba.__version__}, {compiler}.",
            "",
            f"{FULL.motors:,} motors with tolerances, {FULL.ticks:,} ticks each, one thread; the encoder's counts are stored in "
            "16 bits, or nothing but the state at the end.",
            "Processor time, medians and the middle half; ratios are formed within pairs measured in turn. The threads are wall "
            "time, the best of all tries.",
            "The C computes sixteen motors side by side, in AVX-512 registers by hand where the processor has them.",
            *([f"Others kept the processors busy, too: load average {busy:.0f}."] if busy > 2 else []),
            *(
                []
                if peers.exists()
                else ["", "JAX isn't installed in the peers' environment here; its row was not run."]
            ),
            "",
            "| what | median | half of all | limit, goal |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


def command(words: list[str]) -> int:
    """Show the figures, and write the page if that is requested."""
    parser = argparse.ArgumentParser(description="What a tick of one motor of an ensemble costs.")
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks/ensemble.md")
    parser.add_argument("--peers", type=Path, default=PEERS, help="the interpreter of the peers' environment")
    asked = parser.parse_args(words)
    figures = main(peers=asked.peers)
    if asked.write and figures:
        PAGE.write_text(page(figures, asked.peers), encoding="utf-8")
    return shown(figures)


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))

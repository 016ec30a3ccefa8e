"""The cost of a tick of a simulated run, against the same motor in C, SciPy's and python-control's simulations of a linear one.

Processor time, all threads; one of each in turn, so that both meet the same load; the ratio is formed within each pair, and
medians and quartiles are those of the ratios. The C is bench/speed_parts/twin.c, compiled here by `gcc -O3 -march=native`, with
its pointers made beforehand. Unlike the twin, it cuts no tick where the shaft stops or turns back.

    python bench/speed.py           the figures
    python bench/speed.py --jax PYTHON --write   the same with JAX's scan, in an environment that has it (bench/peers)
    python bench/speed.py --write   docs/benchmarks/speed.md, and an entry for each of `KEPT` in bench/history.csv
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import platform
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core, before NumPy is imported

import numpy as np
from figures import Figure, shown
from history import Timing, keep, timed

import servobench as sb
from servobench.core.channels import Array
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.motor.kernels import A00, simulate
from servobench.rig.motor.physics import Physics
from servobench.rig.motor.solvers.exact import coefficients
from servobench.systems.control.pid import Pid

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parent / "docs" / "benchmarks" / "speed.md"
STEP = 0.002  # s
LIMIT = 10.0  # V
SCALE = 2048 / (2 * np.pi)  # counts/rad
KERNEL_CALLS = 20


@dataclass(frozen=True)
class Size:
    """The size of the measurement."""

    ticks: int
    by_ticks: int
    short: int
    pairs: int
    commands: int


FULL = Size(ticks=1_000_000, by_ticks=20_000, short=5_000, pairs=9, commands=5)
SMALLEST = Size(ticks=3_000, by_ticks=1_500, short=500, pairs=2, commands=0)


KEPT = (
    "the twin's kernel, over C",
    "run in memory, open loop, over C",
    "run in memory, PID of the position, over C",
    "run in memory, noise of torque, current and speed, over C",
    "run recorded to MCAP, open loop, over C",
)
"""The part that is kept in bench/history.csv, at a size of its own."""
POSITION = Pid(kp=2.0, ki=0.3, kd=0.05)
KEPT_TICKS, KEPT_PAIRS = 200_000, 9
NOISY = {"torque_noise": 2e-5, "current_noise": 0.01, "tachometer": True, "tachometer_noise": 0.3}


class InC:
    """The motor in C, for a voltage; `textbook` and `free_state` fill its arrays."""

    def __init__(self, folder: Path, c: Array, u: Array) -> None:
        library = folder / "twin.so"
        made = ["gcc", "-O3", "-march=native", "-shared", "-fPIC", "-o", str(library)]
        subprocess.run([*made, str(FOLDER / "speed_parts" / "twin.c"), "-lm"], check=True)
        self.current, self.speed = np.empty(len(u)), np.empty(len(u))
        self.counts = np.empty(len(u), np.int16)
        self._kept = (np.ascontiguousarray(c[A00:]), u)
        pointers = [
            ctypes.c_void_p(array.ctypes.data)
            for array in (*self._kept, self.current, self.speed, self.counts)
        ]
        numbers = (ctypes.c_double(LIMIT), ctypes.c_double(SCALE), ctypes.c_int64(len(u)))
        self._arguments = (pointers[0], *numbers, *pointers[1:])
        self._library = ctypes.CDLL(str(library))

    def textbook(self) -> None:
        self._library.textbook(*self._arguments)

    def free_state(self) -> None:
        self._library.free_state(*self._arguments)


class Own(Twin):
    """A twin as somebody makes it of ours."""


def reference_voltage(ticks: int) -> Array:
    """Return a voltage that reverses the motor a few times a second, and saturates [V]."""
    t = STEP * np.arange(ticks)
    voltage: Array = 3.0 * np.sign(np.sin(2 * np.pi * 0.4 * t)) + 9.0 * np.sin(2 * np.pi * 1.1 * t)
    return voltage


def processor_time(call: Callable[[], object]) -> float:
    """Return the processor time that a call takes [s], without that of removing the file that the one before has written."""
    if isinstance(call, partial) and isinstance(to := call.keywords.get("to"), Path):
        to.unlink(missing_ok=True)
    start = time.process_time()
    call()
    return time.process_time() - start


def ratio(
    what: str, ours: Callable[[], object], theirs: Callable[[], object], pairs: int, **limits: object
) -> Figure:
    """Return how many times as long the one takes as the other."""
    ours()
    theirs()
    found = [processor_time(ours) / processor_time(theirs) for _ in range(pairs)]
    low, middle, high = statistics.quantiles(found, n=4)
    return Figure(what=what, value=middle, half=(low, high), unit="times", **limits)  # type: ignore[arg-type]


def nanoseconds(what: str, call: Callable[[], object], ticks: int, times: int) -> Figure:
    """Return what one of so many ticks costs."""
    call()
    low, middle, high = statistics.quantiles([1e9 * processor_time(call) / ticks for _ in range(times)], n=4)
    return Figure(what=what, value=middle, half=(low, high), unit="ns")


def motor(**changed: float) -> Physics:
    """Return the coefficients of the data sheet's motor, with the twin's friction."""
    return Physics.of(TwinSettings(**changed).parameters)  # type: ignore[arg-type]


def against_c(size: Size, folder: Path) -> list[Figure]:
    """Return the twin's kernel against C, and how far they are from each other."""
    c, u = coefficients(motor(), STEP), reference_voltage(size.ticks)
    held, out = np.clip(u, -LIMIT, LIMIT), np.empty((size.ticks + 1, 3))
    twin = InC(folder, c, u)

    def kernel() -> None:
        simulate(c, 0.0, 0.0, 0.0, held, out)

    found = [
        nanoseconds("textbook C, a tick", twin.textbook, size.ticks, size.pairs),
        nanoseconds("best C, a tick", twin.free_state, size.ticks, size.pairs),
        nanoseconds("the twin's kernel, a tick", kernel, size.ticks, size.pairs),
        ratio("the twin's kernel, over textbook C", kernel, twin.textbook, size.pairs, goal="0.75"),
        ratio("the twin's kernel, over the best C", kernel, twin.free_state, size.pairs, goal="1.1"),
    ]
    plain = coefficients(motor(coulomb_torque=0.0, viscous_friction=1e-6), STEP)
    linear = InC(folder, plain, u)
    linear.free_state()
    simulate(plain, 0.0, 0.0, 0.0, held, out)
    apart = float(np.abs(out[1:, 1] - linear.speed).max())
    limit = Figure(what="without friction, kernel and C differ by", value=apart, unit="rad/s", at_most=1e-9)
    return [*found, limit]


def against_runs(size: Size, folder: Path) -> list[Figure]:
    """Return what a tick of a run costs, recorded and guarded: in blocks and tick by tick, in memory and in a file, against C."""
    c, u = coefficients(motor(), STEP), reference_voltage(size.ticks)
    twin = InC(folder, c, u)
    kinds: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
        "open loop": ({}, {}),
        "PID of the position": ({"controller": POSITION}, {}),
        "noise of torque, current and speed": ({}, NOISY),
    }
    found = []
    for kind, (experiment, settings) in kinds.items():
        blocks = partial(carry_out, experiment, settings, size.ticks)
        plain = partial(carry_out, experiment, settings, size.by_ticks, own=True)
        share = size.ticks / size.by_ticks
        faster = ratio("", plain, blocks, size.pairs)
        found += [
            nanoseconds(f"run in memory, {kind}, a tick", blocks, size.ticks, size.pairs),
            nanoseconds(f"the same tick by tick, {kind}, a tick", plain, size.by_ticks, size.pairs),
            scaled(faster, f"run tick by tick, {kind}, over in blocks", share),
        ]
    to_file = partial(carry_out, {}, {}, size.ticks, to=folder / "run.mcap")
    return [
        *found,
        nanoseconds("run recorded to MCAP, open loop, a tick", to_file, size.ticks, size.pairs),
        ratio(
            "run in memory, open loop, over the best C",
            partial(carry_out, {}, {}, size.ticks),
            twin.free_state,
            size.pairs,
        ),
        ratio(
            "run recorded to MCAP, open loop, over the best C",
            to_file,
            twin.free_state,
            size.pairs,
            goal="40",
        ),
        ratio(
            "the same, and its samples read from the file, over the best C",
            partial(to_file, look=True),
            twin.free_state,
            size.pairs,
        ),
    ]


def measurements(folder: Path) -> dict[str, Callable[[], Timing]]:
    """Return what measures each of `KEPT`, beside the best C, with its files in a folder."""
    c, u = coefficients(motor(), STEP), reference_voltage(KEPT_TICKS)
    held, out = np.clip(u, -LIMIT, LIMIT), np.empty((KEPT_TICKS + 1, 3))
    twin = InC(folder, c, u)
    calls = (
        partial(simulate, c, 0.0, 0.0, 0.0, held, out),
        partial(carry_out, {}, {}, KEPT_TICKS),
        partial(carry_out, {"controller": POSITION}, {}, KEPT_TICKS),
        partial(carry_out, {}, NOISY, KEPT_TICKS),
        partial(carry_out, {}, {}, KEPT_TICKS, to=folder / "kept.mcap"),
    )
    return {
        what: partial(timed, call, KEPT_PAIRS, twin.free_state)
        for what, call in zip(KEPT, calls, strict=True)
    }


def carry_out(
    experiment: dict[str, Any],
    settings: dict[str, Any],
    ticks: int,
    *,
    to: Path | None = None,
    own: bool = False,
    look: bool = False,
) -> None:
    """Carry out a run of so many ticks on the twin, or on one of a user's own, which goes tick by tick; `look` at its samples."""
    with (Own if own else Twin)(TwinSettings(**settings)) as device:
        asked = sb.Experiment(duration=ticks * STEP, sample_time=STEP, **experiment)
        recording = sb.run(asked, device, to=to)
    if look and len(recording["counts"].values) != ticks:
        raise RuntimeError(f"{len(recording['counts'].values)} of {ticks} samples were recorded")


def scaled(figure: Figure, what: str, factor: float) -> Figure:
    """Return a figure times a factor, under another name."""
    low, high = figure.half or (figure.value, figure.value)
    return replace(figure, what=what, value=factor * figure.value, half=(factor * low, factor * high))


def against_peers(size: Size) -> list[Figure]:
    """Return how many times as long others take for a linear motor as the twin's kernel does for one with friction."""
    import control
    from scipy.signal import StateSpace, lsim

    physics = motor(coulomb_torque=0.0)
    a = np.zeros((3, 3))
    a[:2, :2], a[2, 1] = physics.matrix, 1.0
    b, shown_states, nothing = np.array([[1 / physics.inductance], [0.0], [0.0]]), np.eye(3), np.zeros((3, 1))
    u, t = np.clip(reference_voltage(size.short), -LIMIT, LIMIT), STEP * np.arange(size.short)
    out, c = np.empty((size.short + 1, 3)), coefficients(motor(), STEP)
    by_scipy, by_control = StateSpace(a, b, shown_states, nothing), control.ss(a, b, shown_states, nothing)

    def kernel() -> None:
        for _ in range(KERNEL_CALLS):  # one is too short for the processor's clock
            simulate(c, 0.0, 0.0, 0.0, u, out)

    peers: dict[str, tuple[Callable[[], object], float]] = {
        "SciPy lsim": (lambda: lsim(by_scipy, u, t, interp=False), 400),
        "python-control forced_response": (lambda: control.forced_response(by_control, t, u), 500),
    }
    return [
        scaled(
            ratio("", call, kernel, size.pairs, goal=f"{goal:g}"),
            f"{name}, {size.short} samples, over the twin's kernel",
            KERNEL_CALLS,
        )
        for name, (call, goal) in peers.items()
    ]


def against_jax(size: Size, python: str) -> list[Figure]:
    """Return how many times as long JAX takes for the same motor, in a process of its own, compiled before."""
    c = coefficients(motor(), STEP)
    u, out = np.clip(reference_voltage(size.short), -LIMIT, LIMIT), np.empty((size.short + 1, 3))
    words = [python, "-c", "import jax_scan; jax_scan.main()"]
    found = []
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=FOLDER / "speed_parts"
    ) as peer:
        assert peer.stdin is not None
        assert peer.stdout is not None
        for line in (c[A00 : A00 + 12].tolist(), u.tolist()):
            print(json.dumps(line), file=peer.stdin, flush=True)
        for turn in range(1 + KERNEL_CALLS * size.pairs):
            print(file=peer.stdin, flush=True)
            theirs = float(peer.stdout.readline())
            start = time.process_time()
            for _ in range(KERNEL_CALLS):
                simulate(c, 0.0, 0.0, 0.0, u, out)
            ours = (time.process_time() - start) / KERNEL_CALLS
            if turn:
                found.append(theirs / ours)
    low, middle, high = statistics.quantiles(found, n=4)
    what = f"JAX scan, {size.short} samples, over the twin's kernel"
    return [Figure(what=what, value=middle, half=(low, high), unit="times", goal="3")]


def commands(size: Size) -> list[Figure]:
    """Return how long `servobench run` of the paper's experiment takes, all of it, with what was compiled kept."""
    times = []
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, "-m", "servobench", "run", "--overwrite", "--out", folder]
        for _ in range(size.commands and size.commands + 1):
            before = os.times()
            subprocess.run(words, check=True, capture_output=True, env=environment)
            after = os.times()
            times.append(
                after.children_user + after.children_system - before.children_user - before.children_system
            )
    if not times:
        return []
    low, middle, high = statistics.quantiles(times[1:], n=4)
    return [
        Figure(
            what="servobench run, the paper's experiment",
            value=middle,
            half=(low, high),
            unit="s",
            goal="1.5",
        )
    ]


def main(size: Size = FULL, jax: str = "") -> list[Figure]:
    """Return the figures of this bench; none where there is no compiler to compare with. `jax` is a Python that has JAX."""
    if shutil.which("gcc") is None:
        print("speed: gcc isn't installed: nothing was measured", file=sys.stderr)
        return []
    with tempfile.TemporaryDirectory() as folder:
        return [
            *against_c(size, Path(folder)),
            *against_runs(size, Path(folder)),
            *against_peers(size),
            *(against_jax(size, jax) if jax else ()),
            *commands(size),
        ]


def smallest() -> list[Figure]:
    """Return the figures of few ticks."""
    return main(SMALLEST)


def page(figures: list[Figure]) -> str:
    """Return the page that shows the figures."""
    import numba
    import scipy

    compiler = subprocess.run(
        ["gcc", "--version"], capture_output=True, text=True, check=True
    ).stdout.splitlines()[0]
    rows = [
        f"| {each.what} | {each.value:.4g} {each.unit} | {each.half[0]:.4g} to {each.half[1]:.4g} | {each.limit} |"
        if each.half
        else f"| {each.what} | {each.value:.2g} {each.unit} | | {each.limit} |"
        for each in figures
    ]
    machine = f"{platform.machine()}, {os.cpu_count()} processors, {platform.system()} {platform.release()}"
    versions = f"servobench {sb.__version__}, Python {platform.python_version()}, NumPy {np.__version__}, "
    return "\n".join(
        [
            "# Speed of a simulated run",
            "",
            f"Made by `python bench/speed.py --write` on {datetime.now(UTC).date()}: {machine}; {versions}SciPy "
            f"{scipy.__version__}, Numba {numba.__version__}, {compiler}.",
            "",
            "Processor time of all threads, medians and the middle half; ratios are formed within pairs measured in turn.",
            "The runs have the guard on.",
            "The C solves the same motor and stores current, speed and counts of each tick, the kernel current, speed and angle.",
            "The C takes the friction of a tick as one impulse.",
            "The kernel cuts a tick where the shaft stops or turns back, which is more work.",
            "Its other ticks are linear, and have no impulse to clip, which is less.",
            "The voltage reverses the shaft twice a second; the paper's square wave never does.",
            "SciPy and python-control solve the motor without friction, limit and encoder.",
            "",
            "| what | median | half of all | limit, goal |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


def command(words: list[str]) -> int:
    """Show the figures, and write the page if that is requested."""
    parser = argparse.ArgumentParser(description="What a tick of a simulated run costs.")
    parser.add_argument(
        "--write", action="store_true", help="write docs/benchmarks/speed.md, and append to bench/history.csv"
    )
    parser.add_argument(
        "--jax", default="", metavar="PYTHON", help="compare with JAX, by a Python that has it"
    )
    asked = parser.parse_args(words)
    figures = main(jax=asked.jax)
    if asked.write and figures:
        PAGE.write_text(page(figures), encoding="utf-8")
        with tempfile.TemporaryDirectory() as folder:
            keep({what: measure() for what, measure in measurements(Path(folder)).items()})
    return shown(figures)


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:]))

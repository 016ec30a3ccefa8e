"""The time of a short command when nothing must be compiled, against an interpreter that only imports Numba and SciPy.

CPU time of whole processes, children included, one of each in turn, so that both meet the same load; the ratio is formed within
each pair, and the median and the quartiles are those of the ratios.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from figures import Figure, shown

PAIRS = 12
BARE = (sys.executable, "-c", "import numba, scipy.optimize")
SERVOBENCH = (sys.executable, "-m", "servobench")
RATE = 500  # samples a second
SAMPLES = 5000


def write_recording(file: Path) -> None:
    """Write a recording of a motor of 20 rad/(s·V) and 0.1 s, in counts: 10 s of steps between 1 V and 3 V."""
    step, counts = 1 / RATE, 2048 / (2 * 3.141592653589793)
    speed = angle = 0.0
    lines = ["t,u,counts"]
    for k in range(SAMPLES):
        u = 3.0 if k % 1250 < 625 else 1.0
        lines.append(f"{k * step:.3f},{u:g},{angle * counts:.0f}")
        angle += speed * step
        speed += step / 0.1 * (20 * u - speed)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def cpu(words: tuple[str, ...]) -> float:
    """Return the CPU time of a process and those that it starts [s]; bytecode is kept, as it is for a user."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    before = os.times()
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environment)
    after = os.times()
    return after.children_user - before.children_user + after.children_system - before.children_system


def wall(words: tuple[str, ...]) -> float:
    """Return how long a process takes from its start to its end [s]."""
    start = time.perf_counter()
    cpu(words)
    return time.perf_counter() - start


def ratio(name: str, words: tuple[str, ...], pairs: int, at_most: float, *, warm_up: bool = True) -> Figure:
    """Return how many times the CPU time of the bare imports a command takes."""
    asked = (*SERVOBENCH, *words)
    for each in (asked, BARE) if warm_up else ():
        cpu(each)  # once for bytecode, kernels and the disk's cache
    ratios = [cpu(asked) / cpu(BARE) for _ in range(pairs)]
    low, middle, high = statistics.quantiles(ratios, n=4) if pairs > 1 else 3 * ratios
    return Figure(
        what=f"servobench {name}, against import numba, scipy.optimize",
        value=middle,
        half=(low, high),
        unit="times",
        at_most=at_most,
    )


def main(pairs: int = PAIRS, *, warm_up: bool = True) -> list[Figure]:
    """Return the figures of this bench; without a `warm_up` the first process of a kind counts, too."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "motor.csv"
        write_recording(file)
        columns = (
            "--input",
            "u:V",
            "--output",
            "counts:counts",
            "--counts-per-rev",
            "2048",
            "--chain",
            "none",
        )
        figures = [ratio("identify", ("identify", str(file), *columns), pairs, 1.5, warm_up=warm_up)]
        for name, words in {
            "inspect": ("inspect", str(file)),
            "signals": ("signals",),
            "devices": ("devices",),
        }.items():
            figures.append(ratio(name, words, pairs, 1.0, warm_up=warm_up))
        lasted = sorted(wall((*SERVOBENCH, "identify", str(file), *columns)) for _ in range(pairs))
        quickest = Figure(
            what="servobench identify of 5,000 samples, the quickest of all",
            value=lasted[0],
            half=(lasted[len(lasted) // 4], lasted[3 * len(lasted) // 4]),
            unit="s",
            goal="1.0 on a quiet machine",
        )
    return [*figures, quickest]


def smallest() -> list[Figure]:
    """Return the figures of one pair, not warmed up."""
    return main(1, warm_up=False)


if __name__ == "__main__":
    sys.exit(shown(main()))

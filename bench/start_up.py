"""The time of `servobench --help`, against an interpreter that does nothing at all.

Whole processes, one of each in turn, so that both meet the same load; the ratio is formed within each pair, and the median
and the quartiles are those of the ratios.
"""

import statistics
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

from figures import Figure, shown

PAIRS = 40
NOTHING = (sys.executable, "-c", "pass")


def command() -> tuple[str, ...]:
    """Return the installed command, as a user calls it."""
    script = Path(sysconfig.get_path("scripts")) / (
        "servobench.exe" if sys.platform == "win32" else "servobench"
    )
    if not script.exists():
        raise SystemExit(f"there is no {script}: install the package first (make environment)")
    return (str(script),)


def seconds(words: tuple[str, ...]) -> float:
    """Return how long a process takes from its start to its end [s]."""
    start = time.perf_counter()
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def ratio(option: str, pairs: int) -> Figure:
    """Return how many times as long as nothing the command takes with that option."""
    asked = (*command(), option)
    seconds(asked)  # once for the bytecode and the disk's cache
    ratios = [seconds(asked) / seconds(NOTHING) for _ in range(pairs)]
    low, middle, high = statistics.quantiles(ratios, n=4)
    what = f"servobench {option}, against python -c pass"
    return Figure(what=what, value=middle, half=(low, high), unit="times", at_most=8.0, goal="below 3")


def main(pairs: int = PAIRS) -> list[Figure]:
    """Return the figures of this bench."""
    return [ratio("--help", pairs), ratio("--version", pairs)]


def smallest() -> list[Figure]:
    """Return the figures of two pairs."""
    return main(2)


if __name__ == "__main__":
    sys.exit(shown(main()))

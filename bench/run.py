"""Run all benches and print one table; `python bench/run.py start_up` runs those that are named.

A bench is a file in this folder with a function `main` that returns its figures (`figures.Figure`).
The exit status is 1 where a limit isn't kept or a bench failed.
"""

import importlib
import sys
import time
import traceback
from pathlib import Path

from figures import Figure, shown

FOLDER = Path(__file__).resolve().parent
NO_BENCHES = {"figures", "run"}


def benches() -> list[str]:
    """Return the names of all benches."""
    return sorted(path.stem for path in FOLDER.glob("*.py") if path.stem not in NO_BENCHES)


def figures_of(name: str) -> list[Figure]:
    """Return the figures of a bench; one that fails says so, and has a figure that keeps to no limit."""
    start = time.perf_counter()
    print(f"{name} ...", end=" ", flush=True, file=sys.stderr)
    try:
        return list(importlib.import_module(name).main())
    except Exception:
        traceback.print_exc()
        return [Figure(what=f"{name} failed", value=float("nan"), at_most=0.0)]
    finally:
        print(f"{time.perf_counter() - start:.1f} s", file=sys.stderr)


def main(names: list[str]) -> int:
    """Run the benches of those names, all without any, and return the exit status."""
    unknown = sorted(set(names) - set(benches()))
    if unknown:
        print(f"no bench called {', '.join(unknown)}; known: {', '.join(benches())}", file=sys.stderr)
        return 2
    return shown([figure for name in names or benches() for figure in figures_of(name)])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

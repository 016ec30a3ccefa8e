"""Run all benches and print one table; `python bench/run.py start_up` runs those that are named.

A bench is a file in this folder with a function `main` that returns its figures (`figures.Figure`).
The exit status is 1 where a limit isn't kept or a bench failed.

`python bench/run.py --smallest FILE` runs one program below this folder at its smallest size, `smallest()`, to see that it still
runs; what it measures then means nothing.
"""

import importlib
import sys
import time
import traceback
from pathlib import Path

from figures import Figure, shown

FOLDER = Path(__file__).resolve().parent
NO_BENCHES = {"accusations", "figures", "history", "run"}


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


def programs() -> list[str]:
    """Return all files below this folder that can be run by themselves, but this one, as paths from here."""
    found = (
        path for path in FOLDER.rglob("*.py") if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
    )
    return sorted(path.relative_to(FOLDER).as_posix() for path in found if path != Path(__file__).resolve())


def smallest(program: str) -> int:
    """Run a program at its smallest size, print what it gives, and return the exit status: 1 where that is nothing."""
    path = FOLDER / program
    sys.path.insert(0, str(path.parent))
    found = list(importlib.import_module(path.stem).smallest())
    print(*found, sep="\n")
    return 0 if found else 1


def main(names: list[str]) -> int:
    """Run the benches of those names, all without any, and return the exit status."""
    if names[:1] == ["--smallest"]:
        return max(smallest(program) for program in names[1:])
    unknown = sorted(set(names) - set(benches()))
    if unknown:
        print(f"no bench called {', '.join(unknown)}; known: {', '.join(benches())}", file=sys.stderr)
        return 2
    return shown([figure for name in names or benches() for figure in figures_of(name)])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

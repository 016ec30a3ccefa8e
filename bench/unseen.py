"""The time until the motor is at zero volts once its page no longer shows it, by a journal of the voltages that reached it.

A real Chromium drives the simulated motor through `servobench panel`; then the page is frozen by the developer tools, its main
thread goes round in circles, its process is stopped, its processor is slowed 20 times, or its rows come 2 s late. The time counts
from the moment before that was done, on the clock of the journal. A page that is slowed may keep up: there it counts how far
behind it was at most while the motor was driven, by its own beats.
Linux only; it needs the panel's extra, Playwright and Chromium.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the tests' pages and devices

import numpy as np
from figures import Figure, shown
from panel import missing

from tests.panel.browser import chromium
from tests.panel.unseen import LIMIT, WAYS, Journal, panel, unseen
from tests.stories.program import Program

SAMPLE_TIME = 0.002  # s
COUNT = 5


def main(count: int = COUNT, ways: Sequence[str] = tuple(WAYS)) -> list[Figure]:
    """Do each of those to a page so many times."""
    if lacking := missing():
        print(f"unseen: {lacking}: nothing was measured", file=sys.stderr)
        return []
    with tempfile.TemporaryDirectory() as name, panel(Path(name), SAMPLE_TIME) as (program, journal):
        return [figure(way, [once(way, program, journal) for _ in range(count)]) for way in ways]


def smallest() -> list[Figure]:
    """Do one of those once."""
    return main(1, ("2 s behind",))


def once(way: str, program: Program, journal: Journal) -> float:
    """The time to zero volts [s]; of a page that may keep up, how far behind it was at most."""
    with chromium() as browser:
        found = unseen(browser, program, journal, way)
    return found.behind if way.startswith("slowed") else found.zero


def figure(way: str, seconds: list[float]) -> Figure:
    """The longest, with the range in which half of all lie."""
    what = "behind at most while the motor is driven" if way.startswith("slowed") else "until zero volts"
    kept = sum(each <= LIMIT for each in seconds)
    return Figure(
        what=f"page {way}: {what}, longest of {len(seconds)} ({kept} within {LIMIT:g} s)",
        value=max(seconds),
        half=(float(np.quantile(seconds, 0.25)), float(np.quantile(seconds, 0.75))),
        unit="s",
        at_most=LIMIT,
    )


if __name__ == "__main__":
    sys.exit(shown(main()))

"""A damaged file of any format gives recordings, or an error that names the file; no traceback, no hang, and little memory."""

import json
from collections import Counter
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from servobench.recordings.formats.base import FORMATS
from servobench.recordings.loading.load import load
from tests import forks
from tests.recordings.formats.makers import MAKERS, make

FEW, MANY = 100, 1000
COUNTS = [FEW, pytest.param(MANY, marks=pytest.mark.long)]
"""So many damaged copies of a file; the few are the first ones of the many, and are read once where both are asked for."""

MOST_MEMORY = 1e9  # bytes, those of Python and the libraries included
LONGEST = 500  # seconds; a thousand files take about ten, and a hang would take for ever


@cache
def readings(sort: str, seed: int, first: int, last: int) -> dict[str, Any]:
    """Read the damaged copies of a file from the first up to before the last, and return what came of them."""
    with TemporaryDirectory() as folder:
        if sort in FORMATS.names():
            path = make(sort, Path(folder))
        else:
            path = Path(folder) / f"b{FORMATS[sort.split()[0]].suffixes[0]}"
            MAKERS[sort](path)
        assert load(path)
        words = ["-m", "tests.recordings.formats.mutations", str(path), *map(str, (seed, first, last))]
        done = forks.run(words, cwd=Path(__file__).parents[2], timeout=LONGEST)
    assert done.returncode == 0, f"the reader died with {done.returncode}: {done.stderr[-2000:]}"
    assert not done.stderr  # what a library says to the terminal
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def check(sort: str, seed: int, count: int) -> None:
    reports = [readings(sort, seed, first, last) for first, last in pairwise((0, FEW, MANY)) if first < count]
    outcomes: Counter[str] = Counter()
    for report in reports:
        outcomes.update(report["outcomes"])
    unexpected = {said: times for said, times in outcomes.items() if said not in {"read", "refused"}}
    assert not unexpected, "\n".join(f"{times} times {said}" for said, times in unexpected.items())
    assert outcomes.total() == count
    # Or else the mutations are so mild, or so rough, that they test nothing.
    assert min(outcomes["read"], outcomes["refused"]) > 0
    assert max(report["most_memory"] for report in reports) < MOST_MEMORY


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", FORMATS.names())
def test_damaged_files_of_ours_are_read_or_refused(name: str, count: int) -> None:
    check(name, 1, count)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("sort", [sort for sort in MAKERS if " " in sort])
def test_damaged_files_of_others_are_read_or_refused(sort: str, count: int) -> None:
    check(sort, 2, count)

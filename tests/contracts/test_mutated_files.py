"""A damaged file of any format gives recordings, or an error that names the file; no traceback, no hang, and little memory."""

import json
from pathlib import Path
from typing import Any

import pytest

from servobench.recordings.formats.base import FORMATS
from servobench.recordings.loading.load import load
from tests import forks
from tests.recordings.formats.makers import MAKERS, make

COUNTS = [100, pytest.param(1000, marks=pytest.mark.long)]
MOST_MEMORY = 1e9  # bytes, those of Python and the libraries included
LONGEST = 500  # seconds; a thousand files take about ten, and a hang would take for ever


def readings(path: Path, seed: int, count: int) -> dict[str, Any]:
    """Damage the file so many times, and return what came of it."""
    words = ["-m", "tests.recordings.formats.mutations", str(path), str(seed), str(count)]
    done = forks.run(words, cwd=Path(__file__).parents[2], timeout=LONGEST)
    assert done.returncode == 0, f"the reader died with {done.returncode}: {done.stderr[-2000:]}"
    assert not done.stderr  # what a library says to the terminal
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def check(report: dict[str, Any], count: int) -> None:
    unexpected = {
        said: times for said, times in report["outcomes"].items() if said not in {"read", "refused"}
    }
    assert not unexpected, "\n".join(f"{times} times {said}" for said, times in unexpected.items())
    assert sum(report["outcomes"].values()) == count
    # Or else the mutations are so mild, or so rough, that they test nothing.
    assert min(report["outcomes"].get("read", 0), report["outcomes"].get("refused", 0)) > 0
    assert report["most_memory"] < MOST_MEMORY


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", FORMATS.names())
def test_damaged_files_of_ours_are_read_or_refused(name: str, count: int, tmp_path: Path) -> None:
    path = make(name, tmp_path)
    assert load(path)

    check(readings(path, 1, count), count)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("sort", [sort for sort in MAKERS if " " in sort])
def test_damaged_files_of_others_are_read_or_refused(sort: str, count: int, tmp_path: Path) -> None:
    path = tmp_path / f"b{FORMATS[sort.split()[0]].suffixes[0]}"
    MAKERS[sort](path)
    assert load(path)

    check(readings(path, 2, count), count)

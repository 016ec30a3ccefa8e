"""A damaged file of any format gives recordings, or an error that names the file; no traceback, no hang, and little memory."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from servobench.recordings.formats.base import FORMATS, load
from tests.recordings.formats.makers import MAKERS, make

MUTATIONS = 1000
MOST_MEMORY = 1e9  # bytes, those of Python and the libraries included
LONGEST = 500  # seconds; a thousand files take about ten, and a hang would take for ever


def readings(path: Path, seed: int) -> dict[str, Any]:
    """Damage the file 1,000 times, and return what came of it."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.recordings.formats.mutations", str(path), str(seed), str(MUTATIONS)],
        capture_output=True,
        text=True,
        check=False,
        timeout=LONGEST,
        cwd=Path(__file__).parents[2],
    )
    assert done.returncode == 0, f"the reader died with {done.returncode}: {done.stderr[-2000:]}"
    assert not done.stderr  # what a library says to the terminal
    report: dict[str, Any] = json.loads(done.stdout)
    return report


def check(report: dict[str, Any]) -> None:
    unexpected = {
        said: count for said, count in report["outcomes"].items() if said not in {"read", "refused"}
    }
    assert not unexpected, "\n".join(f"{count} times {said}" for said, count in unexpected.items())
    assert sum(report["outcomes"].values()) == MUTATIONS
    # Or else the mutations are so mild, or so rough, that they test nothing.
    assert min(report["outcomes"].get("read", 0), report["outcomes"].get("refused", 0)) > 0
    assert report["most_memory"] < MOST_MEMORY


@pytest.mark.parametrize("name", FORMATS.names())
def test_a_thousand_damaged_files_of_ours_are_read_or_refused(name: str, tmp_path: Path) -> None:
    path = make(name, tmp_path)
    assert load(path)

    check(readings(path, seed=1))


@pytest.mark.parametrize("sort", [sort for sort in MAKERS if " " in sort])
def test_a_thousand_damaged_files_of_others_are_read_or_refused(sort: str, tmp_path: Path) -> None:
    path = tmp_path / f"b{FORMATS[sort.split()[0]].suffixes[0]}"
    MAKERS[sort](path)
    assert load(path)

    check(readings(path, seed=2))

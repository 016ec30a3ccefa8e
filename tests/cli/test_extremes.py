"""Values that no motor has end as a result or as one sentence, without a warning, whatever the format and the command."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import environment

CPU_SECONDS = 60.0  # after which no further file is begun; on the code before, 43 of the 120 commands of 60 seeds went wrong


@pytest.mark.promise("S60")
@pytest.mark.parametrize(("first", "seeds"), [(0, 10), pytest.param(10, 50, marks=pytest.mark.long)])
def test_extremes_end_as_a_result_or_a_sentence(tmp_path: Path, first: int, seeds: int) -> None:
    fewest = min(30, 2 * seeds)  # commands, however slow the machine is: or else the test would test nothing
    ended = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            "-m",
            "tests.cli.extremes",
            str(first),
            str(seeds),
            str(tmp_path),
            str(CPU_SECONDS),
        ],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[2],
        env=environment(),
    )

    assert ended.returncode == 0, ended.stderr[-3000:]
    report = json.loads(ended.stdout)
    assert report["wrong"] == []
    assert report["done"] >= fewest

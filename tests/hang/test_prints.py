"""A device whose driver prints stops no run, and its words don't get into the answer."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

if sys.platform != "win32":
    from tests.hang.terminal import LONGEST, Bench, bench

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the bench is POSIX's")


@pytest.fixture
def hanging(tmp_path: Path) -> Iterator[Bench]:
    with bench(tmp_path) as found:
        yield found


def test_a_driver_that_prints_at_every_read_neither_stops_the_run_nor_spoils_its_json(hanging: Bench) -> None:
    # 500 reads of 450 characters are three times what a pipe holds.
    hanging.begin(call="read", how="prints", duration="1 s", after=0.0)
    words = ["run", hanging.experiment, "--out", hanging.out, "--json"]
    ended = subprocess.run(
        [sys.executable, "-m", "servobench", *map(str, words)],
        env=hanging.environment,
        cwd=hanging.folder,
        capture_output=True,
        text=True,
        timeout=LONGEST,
    )

    assert ended.returncode in (0, 3), ended.stderr  # what such a short run tells is another matter
    assert json.loads(ended.stdout)["schema"].startswith("servobench.result/")
    assert "from the device's driver: warning: a driver's words" in ended.stderr
    assert r"\x1b[31mread number" in ended.stderr
    assert "SWITCH OFF" not in ended.stderr

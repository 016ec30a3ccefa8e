"""A failure counts at once on a computer that has time, and is tried again, and shown, on a busy one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TESTS = """
from pathlib import Path
import pytest

TRIES = Path(__file__).with_name("tries")

@pytest.fixture(scope="module")
def number():
    TRIES.write_text(TRIES.read_text() + "x" if TRIES.exists() else "x")
    yield len(TRIES.read_text())

def test_that_fails_once(number):
    assert number >= 2, "once"

def test_that_fails_each_time(number):
    assert False, "each time"

def test_that_passes(number):
    pass
"""


@pytest.mark.parametrize(
    ("busy", "outcome", "shown"), [(True, "1 failed, 2 passed", 2), (False, "2 failed, 1 passed", 0)]
)
@pytest.mark.parametrize("options", [(), ("--numprocesses", "1")])
def test_a_test_that_fails_is_tried_again_on_a_busy_computer_and_shown(
    tmp_path: Path, busy: bool, outcome: str, shown: int, options: tuple[str, ...]
) -> None:
    (tmp_path / "test_some.py").write_text(TESTS)
    (tmp_path / "conftest.py").write_text(
        "import tests.busy_computer as found\n"
        "from tests.busy_computer import pytest_runtest_protocol, pytest_terminal_summary\n"
        f"found.is_busy = lambda: {busy}\n"
    )
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-c",
        os.devnull,
        "--rootdir",
        tmp_path,
        "-p",
        "no:cacheprovider",
    ]
    path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
    ended = subprocess.run(
        [*map(str, command), *options, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "PYTHONPATH": path},
    )

    assert outcome in ended.stdout, ended.stdout + ended.stderr
    section = ended.stdout.partition("failed at first, on a busy computer")[2]
    assert sum(line.startswith("test_some.py::") for line in section.splitlines()) == shown

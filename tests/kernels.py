"""The kernels that many tests use, compiled before the first one: each of their processes would compile them for itself at once.

That concerns the first run of all tests after kernels were changed, and every one of a fresh clone. Run as a program, this
compiles one of the two halves, which have next to nothing in common.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
MANY = 1000
"""So many tests wait for the kernels; fewer ones may not need them."""

_compilers = pytest.StashKey[list[subprocess.Popen[bytes]]]()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Begin to compile where tests are handed out to several processes, which look for their tests meanwhile."""
    config = session.config
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        config.stash[_compilers] = [
            # What goes wrong here goes wrong in a test, too, and says so there.
            subprocess.Popen(
                [sys.executable, "-m", "tests.kernels", half],
                cwd=ROOT,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            for half in HALVES
        ]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: Any, ids: list[str]) -> None:
    """Give out no test before the kernels are there."""
    if len(ids) > MANY:
        for each in node.config.stash.get(_compilers, []):
            each.wait()


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Leave no process behind, whatever ended the tests."""
    for each in session.config.stash.get(_compilers, []):
        each.kill()
        each.wait()


def _identification() -> None:
    import servobench as sb

    path = ROOT / "examples" / "logger.csv"
    sb.identify(path, time="time:s", input="voltage:V", output="angle:deg").to_dict()


def _rig() -> None:
    import servobench as sb
    from servobench.cli import main

    with sb.connect("twin") as motor:
        sb.run(sb.Experiment(duration=5), motor)
    text = (ROOT / "examples" / "real_time.toml").read_text(encoding="utf-8")
    with (
        tempfile.TemporaryDirectory() as folder
    ):  # by the computer's clock; what it identifies the other half has compiled
        (Path(folder) / "short.toml").write_text(text.replace('"5.08 s"', '"1 s"'), encoding="utf-8")
        main(["run", f"{folder}/short.toml", "--out", f"{folder}/run"])


HALVES: dict[str, Callable[[], None]] = {"identification": _identification, "rig": _rig}

if __name__ == "__main__":
    HALVES[sys.argv[1]]()

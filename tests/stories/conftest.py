"""The Python that a story's person has: the one of the tests, and in the long tests one with nothing but the built package."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.processes import alone

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session", params=["here", pytest.param("fresh", marks=pytest.mark.long)])
def python(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Python that can import servobench, freshly installed or not."""
    if request.param == "here":
        return Path(sys.executable)
    # One for all processes that run tests: building takes some seconds, and the first commands half a minute, as they compile.
    shared = tmp_path_factory.getbasetemp()
    shared = shared.parent if "PYTEST_XDIST_WORKER" in os.environ else shared
    with alone(shared / "fresh.lock"):
        ready = shared / "fresh.ready"
        if not ready.exists():
            shutil.rmtree(shared / "fresh", ignore_errors=True)  # a first try that went wrong
            found = install_fresh(shared / "fresh" / "env")
            compile_kernels(found, shared / "fresh")
            ready.touch()
    return shared / "fresh" / "env" / "bin" / "python"


def compile_kernels(python: Path, folder: Path) -> None:
    """Run and identify, as a user of a fresh installation does first: two at a time would compile the same kernels."""
    done = subprocess.run(
        [python, "-m", "servobench", "run", "--out", folder / "run"],
        cwd=folder, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def install_fresh(place: Path) -> Path:
    """An environment into which the package was built and installed a moment ago; what it depends on comes from this one."""

    def run(*words: str | Path) -> None:
        done = subprocess.run([*map(str, words)], capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr

    run(sys.executable, "-m", "venv", "--without-pip", place)
    found, pip = place / "bin" / "python", (sys.executable, "-m", "pip", "--disable-pip-version-check")
    run(
        *pip, "wheel", "--no-index", "--no-deps", "--no-build-isolation", "--wheel-dir", place / "built", ROOT
    )
    (wheel,) = (place / "built").glob("*.whl")
    run(*pip, "--python", found, "install", "--no-index", "--no-deps", wheel)
    library = sysconfig.get_path("purelib", vars={"base": str(place), "platbase": str(place)})
    # A line of such a file is a folder to look in; files of that kind in that folder, as of an editable install, don't count.
    (Path(library) / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return found

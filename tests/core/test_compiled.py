"""Compiled code is kept on disk for the next process, and nothing depends on that."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

KERNELS = """
from servobench.core.compiled import code_is_kept, compiled

@compiled
def double(x):
    return 2 * x

@compiled
def triple(x):
    return 3 * x

print(double(3.0), triple(3.0), len(double.stats.cache_hits), code_is_kept())
"""

ONCE = "compiling the numeric kernels; this is done once and kept\n"
"""The message of the first call in a fresh install, and of no other."""


@pytest.fixture
def use(tmp_path: Path) -> Callable[..., tuple[str, str]]:
    """Return a function that uses two kernels in a new process, and returns what it printed and what it warned of."""
    (tmp_path / "kernels.py").write_text(KERNELS)

    def in_a_new_process(**changed: str) -> tuple[str, str]:
        kept = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA")}
        ended = subprocess.run(
            [sys.executable, "-c", "import kernels"],
            cwd=tmp_path,
            env={**kept, **changed},
            capture_output=True,
            text=True,
            timeout=300,
        )
        assert ended.returncode == 0, ended.stderr
        return ended.stdout.strip(), ended.stderr

    return in_a_new_process


CALLED = """
from servobench.core.compiled import compiled

@compiled
def called(x):
    return {0} * x
"""
CALLING = """
from own import called_kernels
from own.numbers import OFFSET
from servobench.core.compiled import compiled

@compiled
def calling(x):
    return called_kernels.called(x) + OFFSET

print(calling(1.0), len(calling.stats.cache_hits))
"""


def test_a_change_of_a_kernel_that_is_called_or_of_a_constant_renews_the_one_that_calls(
    tmp_path: Path, use: Callable[..., tuple[str, str]]
) -> None:
    """Python's own cache of bytes goes by the second, so that it is left out."""
    plain = {"PYTHONDONTWRITEBYTECODE": "1"}
    own = tmp_path / "own"
    own.mkdir()
    (tmp_path / "kernels.py").write_text("import own.calling\n")
    (own / "calling.py").write_text(CALLING)
    (own / "called_kernels.py").write_text(CALLED.format(2))
    (own / "numbers.py").write_text("OFFSET = 0.0\n")
    assert use(**plain)[0] == "2.0 0"
    assert use(**plain)[0] == "2.0 1"

    (own / "called_kernels.py").write_text(CALLED.format(3))
    assert use(**plain)[0] == "3.0 0"
    (own / "numbers.py").write_text("OFFSET = 1.0\n")
    assert use(**plain)[0] == "4.0 0"
    os.utime(own / "calling.py")
    assert use(**plain)[0] == "4.0 1"


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def emptied(file: Path) -> None:
    file.write_bytes(b"")


def zeroed(file: Path) -> None:
    """As a power cut leaves a file that was never put on the disk."""
    file.write_bytes(bytes(file.stat().st_size))


@pytest.mark.promise("S57")
@pytest.mark.parametrize(
    ("which", "damaged"),
    [
        ("nbi", cut),
        ("nbi", zeroed),
        ("nbc", emptied),
        pytest.param("nbi", emptied, marks=pytest.mark.long),
        pytest.param("nbc", cut, marks=pytest.mark.long),
        pytest.param("nbc", zeroed, marks=pytest.mark.long),
    ],
)
def test_a_damaged_cache_is_reported_once_and_renewed(
    tmp_path: Path, use: Callable[..., tuple[str, str]], damaged: Callable[[Path], None], which: str
) -> None:
    assert use() == ("6.0 9.0 0 True", ONCE)
    assert use() == ("6.0 9.0 1 True", "")
    files = list((tmp_path / "__pycache__").glob(f"*.{which}"))
    assert len(files) == 2
    for file in files:
        damaged(file)

    printed, warned = use()

    assert printed == "6.0 9.0 0 False"
    assert warned.startswith(f"compiled code in {tmp_path / '__pycache__'} can't be read (")
    assert warned.count("\n") == 1
    assert use() == ("6.0 9.0 1 True", "")


@pytest.mark.promise("S57")
def test_where_nothing_can_be_written_it_is_reported_once_and_compiled_each_time(
    tmp_path: Path, use: Callable[..., tuple[str, str]]
) -> None:
    # Files in the place of folders: the rights of a folder don't bind root.
    (tmp_path / "__pycache__").touch()
    nowhere = str(tmp_path / "kernels.py")
    for _ in range(2):
        printed, warned = use(HOME=nowhere, XDG_CACHE_HOME=nowhere, LOCALAPPDATA=nowhere)

        assert printed == "6.0 9.0 0 False"
        assert warned.startswith(
            "compiled code can't be kept, as neither the package nor the home folder can be written"
        )
        assert warned.count("\n") == 1


@pytest.mark.promise("S57")
@pytest.mark.skipif(sys.platform == "win32", reason="ulimit is POSIX's")
def test_code_that_finds_no_room_is_reported_once(
    tmp_path: Path, use: Callable[..., tuple[str, str]]
) -> None:
    text = (tmp_path / "kernels.py").read_text()
    limit = "import resource, sys; sys.dont_write_bytecode = True; resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n"
    (tmp_path / "kernels.py").write_text(text.replace("print(", f"{limit}print("))

    printed, warned = use()

    assert printed == "6.0 9.0 0 False"
    assert warned.startswith(ONCE)  # before it is known that it can't be kept
    warned = warned.removeprefix(ONCE)
    assert warned.startswith(f"compiled code can't be kept in {tmp_path / '__pycache__'} (File too large)")
    assert warned.count("\n") == 1


def test_whoever_announces_compiling_in_his_own_way_is_not_reported_twice(
    tmp_path: Path, use: Callable[..., tuple[str, str]]
) -> None:
    quiet = KERNELS.replace(
        "import code_is_kept, compiled", "import code_is_kept, compiled, keep_announcement_quiet"
    )
    lines = quiet.replace("print(", "with keep_announcement_quiet():\n    print(")
    (tmp_path / "kernels.py").write_text(lines)

    assert use() == ("6.0 9.0 0 True", "")

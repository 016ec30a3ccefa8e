"""Scripts as a user types them, run by a Python of their own: in an empty folder, with a home in which nobody has been."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests import forks


def run_script(text: str, folder: Path, python: Path) -> str:
    """The output of a script; fails with its standard error if it doesn't end well."""
    return run([python, "-c", text], folder)


def run_command(folder: Path, python: Path, *words: str) -> str:
    """The output of a command that a user types in a folder; fails if it doesn't end well."""
    return run([python, "-m", "servobench", *words], folder)


def run(words: Sequence[str | Path], folder: Path) -> str:
    """The output of a program in a folder; fails with its standard error if it doesn't end well."""
    home = folder / "home"
    home.mkdir(exist_ok=True)
    environment = {**os.environ, "HOME": str(home), "XDG_CACHE_HOME": str(home), "MPLBACKEND": "agg"}
    command = [*map(str, words)]
    if command[0] == sys.executable:  # a fresh installation begins with an interpreter of its own
        done = forks.run(command[1:], cwd=folder, env=environment)
    else:
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300
        )
    assert done.returncode == 0, done.stderr
    return done.stdout

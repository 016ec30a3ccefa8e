"""Scripts as a user types them, run by a Python of their own: in an empty folder, with a home in which nobody has been."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path


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
    done = subprocess.run(
        [*map(str, words)], cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout

"""Scripts as a user types them, run by a Python of their own: in an empty folder, with a home in which nobody has been."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path


def run_script(text: str, folder: Path) -> str:
    """What a script prints; fails with what it wrote to the standard error where it doesn't end well."""
    home = folder / "home"
    home.mkdir(exist_ok=True)
    environment = {**os.environ, "HOME": str(home), "XDG_CACHE_HOME": str(home), "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, "-c", text], cwd=folder, env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done.stdout

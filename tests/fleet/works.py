"""Things for a worker to do that workers don't survive; a module of its own, as the processes import it."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def double(number: int) -> int:
    """Return twice a number; 13 kills the process."""
    if number == 13:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def double_once_killed(marks: Path, number: int) -> int:
    """Return twice a number; at 7 the process is killed the first time, as by somebody who needs memory."""
    mark = marks / "killed"
    if number == 7 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def threads(_: int) -> str:
    """Return how many threads this process may use for linear algebra."""
    return os.environ["OMP_NUM_THREADS"]

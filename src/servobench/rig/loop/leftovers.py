"""Removal of shared memory left behind by killed runs. Quick to import, for every command."""

from __future__ import annotations

import os
import sys
import time
from contextlib import suppress
from pathlib import Path

from servobench.recordings.native.lease import hold

FOLDER = "/dev/shm"
"""The folder of Linux's shared memory. It can be small in a container, and touching more than there is kills the process."""
NEW = 5.0  # s; a process may be about to lock younger memory


def sweep() -> None:
    """Remove the memory of runs whose processes were all killed; only Linux lists it.

    Each process of a run holds a lock on its memory (`lease.share`), which the system lets go of with the process; so this holds
    in another container that shares the memory, too. Never raises; takes about 0.1 ms.
    """
    if sys.platform != "linux":
        return
    for path in Path(FOLDER).glob("servobench-*-*-*"):
        with suppress(OSError):  # another user's, or gone by now
            if _is_left(path):
                path.unlink()


def _is_left(path: Path) -> bool:
    """Whether no process uses the memory any more: neither its owner, whose number is in the name, nor an attached one."""
    owner = path.name.split("-")[2]
    if not owner.isdigit() or _lives(int(owner)) or time.time() - path.stat().st_mtime < NEW:
        return False
    with path.open("r+b") as file:
        return hold(file)


def _lives(process: int) -> bool:
    """Whether there is a process of that number."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:  # another user's
        return True
    return True

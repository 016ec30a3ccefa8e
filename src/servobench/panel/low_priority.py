"""Background processes: on one processor and at the lowest priority, so that neither the loop nor a page waits for them."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from contextlib import suppress

_NICER = 10
FLAGS: int = getattr(subprocess, "BELOW_NORMAL_PRIORITY_CLASS", 0)
"""The flags for Windows when one is started."""


def surroundings() -> Mapping[str, str]:
    """Return the environment to start one in: the threads of linear algebra would spin on processors that the loop needs."""
    one_thread = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    return {**os.environ, **one_thread}


def give_way() -> None:
    """Let others have the processor first, in the process itself; where that can't be, it goes on as it is."""
    if hasattr(os, "nice"):
        with suppress(OSError):
            os.nice(_NICER)

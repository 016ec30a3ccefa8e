"""The simulated rig as a program at a pseudo-terminal: what a real port and a real process are like."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tests.rig.simavr import build


class Terminal:
    """A running rig and the name of its port."""

    def __init__(self, process: subprocess.Popen[str], port: str) -> None:
        self._process = process
        self.port = port

    def look(self) -> dict[str, Any]:
        """The rig's present state; `cycle`, `pwm_high` and `received` count device time in cycles of 16 MHz."""
        self.tell("look")
        assert self._process.stdout
        found = json.loads(self._process.stdout.readline())
        assert isinstance(found, dict)
        return found

    def tell(self, line: str) -> None:
        """Give it a line: `look`, `block 1`, `block 0`."""
        assert self._process.stdin
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def unplug(self) -> None:
        """End it, as where its cable is pulled out."""
        self._process.kill()
        self._process.wait()


@contextmanager
def terminal(firmware: str = "rig-500000", **around: float) -> Iterator[Terminal]:
    """Run a simulated rig, with that motor around it; its end is the end of the `with` statement."""
    words = [
        str(build.program()),
        str(build.firmware(firmware)),
        *(f"{name}={value!r}" for name, value in around.items()),
    ]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            yield Terminal(process, process.stdout.readline().strip())
        finally:
            process.kill()

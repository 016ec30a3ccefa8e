"""A command in a terminal of its own, and what its device's journal says."""

from __future__ import annotations

import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from tests.cli.conftest import environment

LONGEST = 120.0  # s; a second interpreter and its kernels, on a busy machine
ENTRY_POINT = "[servobench.devices]\nhanging = tests.hang.plug_in:Hanging\n"
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Line:
    """A line of the journal: when [s of the monotonic clock], in which process, and what."""

    time: float
    process: int
    words: tuple[str, ...]


@dataclass
class Bench:
    """A folder with an experiment on the device that hangs, and its journal."""

    folder: Path
    environment: dict[str, str] = field(default_factory=dict)

    @property
    def journal(self) -> Path:
        return self.folder / "journal"

    @property
    def experiment(self) -> Path:
        return self.folder / "experiment.toml"

    @property
    def out(self) -> Path:
        return self.folder / "run"

    def lines(self) -> list[Line]:
        """The lines journalled so far; a line that is being written is left out."""
        text = self.journal.read_text() if self.journal.exists() else ""
        words = [line.split() for line in text[: text.rfind("\n") + 1].splitlines()]
        return [Line(float(each[0]), int(each[1]), tuple(each[2:])) for each in words]

    def when(self, word: str) -> float:
        """Wait for the first line that begins with a word; return its time."""
        deadline = time.monotonic() + LONGEST
        while time.monotonic() < deadline:
            for line in self.lines():
                if line.words[0] == word:
                    return line.time
            time.sleep(0.01)
        raise AssertionError(f"no {word!r} in the journal: {self.lines()[-5:]}")

    @property
    def loop(self) -> int:
        """The number of the loop's process."""
        return self.lines()[-1].process

    def begin(self, *, duration: str = "600 s", **settings: object) -> None:
        """Write an experiment with a device of these settings."""
        given = {"journal": self.journal.as_posix(), **settings}
        lines = [f"{name} = {_toml(value)}" for name, value in given.items()]
        self.experiment.write_text(
            f'[experiment]\nduration = "{duration}"\nsample_time = "2 ms"\n[signal]\ntype = "constant"\nvalue = "2 V"\n'
            # A busy machine's missed ticks end nothing here, and its watchdog is patient.
            '[when_late]\nmissed = "process"\n[limits.watchdog]\ntimeout = "0.3 s"\n'
            '[device]\nname = "hanging"\n[device.settings]\n' + "\n".join(lines) + "\n"
        )


def _toml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool | float) else f'"{value}"'


@contextmanager
def bench(folder: Path) -> Iterator[Bench]:
    """A bench whose processes are gone in the end, whatever happens."""
    metadata = folder / "plugins" / "hanging-1.dist-info"
    metadata.mkdir(parents=True)
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: hanging\nVersion: 1\n")
    (metadata / "entry_points.txt").write_text(ENTRY_POINT)
    found = Bench(folder, environment(PYTHONPATH=os.pathsep.join([str(metadata.parent), str(ROOT)])))
    try:
        yield found
    finally:
        for process in {line.process for line in found.lines()} - {os.getpid()}:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)


class Terminal:
    """A command in a pty of its own, so that Ctrl-C and Ctrl-\\ reach all its processes as they do in a terminal."""

    def __init__(self, bench: Bench, *words: object) -> None:
        self._said: list[tuple[float, str]] = []
        self._master, slave = pty.openpty()
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.hang.in_terminal", *map(str, words)],
            env=bench.environment,
            cwd=bench.folder,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
        )
        os.close(slave)

    def __enter__(self) -> Terminal:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._master)

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def said(self) -> str:
        """All that stood on the terminal so far."""
        return "".join(text for _, text in self._said)

    def press(self, key: str) -> float:
        """Press Ctrl and a key; return when."""
        os.write(self._master, bytes([ord(key.upper()) & 0x1F]))
        return time.monotonic()

    def send(self, number: signal.Signals) -> float:
        """Send the command a signal; return when."""
        self._process.send_signal(number)
        return time.monotonic()

    def await_words(self, words: str) -> float:
        """Wait until words stand on the terminal; return when they came."""
        deadline = time.monotonic() + LONGEST
        while words not in self.said:
            assert time.monotonic() < deadline, f"no {words!r} in {self.said!r}"
            assert self._process.poll() is None or self._read(), f"no {words!r} in {self.said!r}"
            self._read()
        return self._said[-1][0]

    def await_end(self) -> tuple[int, float]:
        """Wait for the end of the command; return its status, and when it was."""
        deadline = time.monotonic() + LONGEST
        while self._process.poll() is None:
            assert time.monotonic() < deadline, f"it goes on; it said {self.said!r}"
            self._read()
        ended = time.monotonic()
        while self._read():
            pass
        return self._process.returncode, ended

    def _read(self) -> bool:
        """Take what stands on the terminal by now."""
        if not select.select([self._master], [], [], 0.02)[0]:
            return False
        try:
            text = os.read(self._master, 65536).decode(errors="replace")
        except OSError:  # all who could write are gone
            return False
        self._said.append((time.monotonic(), text))
        return bool(text)


def gone(process: int, within: float) -> bool:
    """Return whether a process has ended by then [s]; a dead one that isn't reaped has."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        try:
            stat = Path(f"/proc/{process}/stat").read_text()
        except OSError:
            return True
        if stat.rpartition(")")[2].split()[0] in "ZX":
            return True
        time.sleep(0.02)
    return False

"""Runs by the wall clock with a board that keeps the time: the device of docs/how-to/device.md at a pseudo-terminal.

    python bench/board.py --count 20

At the other end a child process computes a motor with a gain of 20 rad/(s·V) and a time constant of 0.1 s, sends a line in
each tick of its own clock, and takes voltages when they come; its lines say since when it has had the last one. Each run is
`servobench run board.toml`; what is printed of it is the verdict, the parameters with their intervals, and how long after its
tick the board had each voltage. The port is opened by pyserial where that is installed, and otherwise by what this file has of
it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import select
import signal
import subprocess
import sys
import tempfile
import termios
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from figures import Figure, shown

COUNT, DURATION, RATE = 20, 5.0, 200.0  # runs, s, ticks in a second
PAGE = Path(__file__).resolve().parents[1] / "docs" / "how-to" / "device.md"
GAIN, TIME_CONSTANT, COUNTS = 20.0, 0.1, 2048  # rad/(s·V), s, counts a turn
TRUTH = {"gain": GAIN, "time_constant": TIME_CONSTANT}
SILENCE = 0.1  # s; a board that hears nothing for so long puts out zero volts, as the page asks for
EXPERIMENT = """
[experiment]
duration = "{duration} s"
sample_rate = "{rate} Hz"

[signal]
type = "prbs"
low = "-3 V"
high = "3 V"
bit_time = "40 ms"

[device]
name = "board"

[device.settings]
port = "{port}"
"""
ENTRY_POINT = "[servobench.devices]\nboard = board:Board\n"
SERIAL = '''"""What the page needs of pyserial."""
import os, select, termios, time, tty

class SerialException(OSError):
    pass

class Serial:
    def __init__(self, name, baud, timeout):
        try:
            self.fd = os.open(name, os.O_RDWR | os.O_NOCTTY)
        except OSError as error:
            raise SerialException(error.errno, f"could not open port {name}: {error}") from None
        tty.setraw(self.fd)
        self.timeout, self.waiting = timeout, b""

    def readline(self):
        until = time.monotonic() + self.timeout
        while b"\\n" not in self.waiting and (left := until - time.monotonic()) > 0:
            if select.select([self.fd], [], [], left)[0]:
                self.waiting += os.read(self.fd, 4096)
        line, end, rest = self.waiting.partition(b"\\n")
        self.waiting = rest
        return line + end

    def write(self, data):
        return os.write(self.fd, data)

    def reset_input_buffer(self):
        self.waiting = b""
        termios.tcflush(self.fd, termios.TCIFLUSH)

    def close(self):
        os.close(self.fd)
'''


@dataclass
class Motor:
    """A motor that follows the wall clock: speed [rad/s] and angle [rad] at `time` [s], under `voltage` [V] since then."""

    time: float
    voltage: float = 0.0
    speed: float = 0.0
    angle: float = 0.0

    def advance(self, time: float) -> None:
        """Let the time pass, exactly."""
        dt, steady = time - self.time, GAIN * self.voltage
        kept = math.exp(-dt / TIME_CONSTANT)
        self.angle += steady * dt + (self.speed - steady) * TIME_CONSTANT * (1 - kept)
        self.speed = steady + (self.speed - steady) * kept
        self.time = time


class Board:
    """The board at the master's end of a pseudo-terminal; it ends when nobody has the other end open any more."""

    def __init__(self, port: int) -> None:
        self._port, self._received = port, b""
        self._motor = Motor(time.monotonic())
        self._period, self._began, self._tick = math.inf, math.inf, 0
        self._heard, self._since = -math.inf, 0.0
        self.delays: list[float] = []

    def serve(self) -> None:
        """Send a line in each tick, and take what comes in between."""
        while True:
            wait = min(max(self._due - time.monotonic(), 0.0), SILENCE)
            if select.select([self._port], [], [], wait)[0]:
                try:
                    self._take(os.read(self._port, 4096))
                except OSError:  # the other end was closed
                    return
            self._advance(time.monotonic())
            if self._motor.time - self._heard > SILENCE:
                self._motor.voltage = 0.0

    @property
    def _due(self) -> float:
        return self._began + self._tick * self._period if self._period < math.inf else math.inf

    def _advance(self, now: float) -> None:
        """Let the motor turn until now; a timer counts at each tick on the way, however late this process is."""
        while self._due <= now:
            self._motor.advance(self._due)
            self._send()
        self._motor.advance(now)

    def _send(self) -> None:
        counts = math.floor(self._motor.angle * COUNTS / (2 * math.pi))
        microseconds = [round(1e6 * x) for x in (self._tick * self._period, self._since)]
        os.write(self._port, f"{self._tick} {microseconds[0]} {counts} {microseconds[1]}\n".encode())
        self._tick += 1

    def _take(self, data: bytes) -> None:
        *lines, self._received = (self._received + data).split(b"\n")
        for line in lines:
            word, _, value = line.decode().partition(" ")
            now = self._heard = time.monotonic()
            self._advance(now)
            if word == "start":
                self._period, self._began, self._tick = float(value), now, 0
                self._motor, self._since = Motor(now), 0.0
            elif word == "stop":
                self._motor.voltage, self._period = 0.0, math.inf
            elif word == "u":
                if float(value) != self._motor.voltage:
                    self._motor.voltage, self._since = float(value), now - self._began
                self.delays.append(now - self._began - (self._tick - 1) * self._period)


def serve(port: int) -> None:
    """Be the board until the other end is closed, then print how late the voltages came [s]: median, 99 of 100, most."""
    board = Board(port)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    try:
        board.serve()
    finally:
        late = sorted(board.delays) or [math.nan]
        print(json.dumps([late[len(late) // 2], late[int(0.99 * len(late))], late[-1]]))


def installed(folder: Path) -> dict[str, str]:
    """Write the page's device into a folder as a package that is installed, and return the environment in which it is found."""
    text = PAGE.read_text(encoding="utf-8")
    for name in ("board.py", "pretend.py"):
        block = re.search(rf"`{name}`[^`]*:\n\n```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
        if block is None:
            raise SystemExit(f"{PAGE} doesn't have {name} any more")
        (folder / name).write_text(block[1], encoding="utf-8")
    about = folder / "servobench_board-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: servobench-board\nVersion: 1\n")
    (about / "entry_points.txt").write_text(ENTRY_POINT)
    if find_spec("serial") is None:
        (folder / "serial.py").write_text(SERIAL)
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])}


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """One run: its exit status, its result (None where it printed none), what it said, and how late voltages came [s]."""

    status: int
    result: dict[str, object] | None
    said: str
    late: list[float]

    @property
    def trusted(self) -> bool:
        """Whether the result is trusted."""
        return self.result is not None and self.result["verdict"] == "trusted"

    @property
    def missed(self) -> list[str]:
        """The parameters of which the interval misses the truth."""
        told = self.result["parameters"] if self.result else {}
        return [
            name
            for name, value in TRUTH.items()
            if name not in told  # type: ignore[operator]
            or not told[name]["interval"][0] <= value <= told[name]["interval"][1]  # type: ignore[index]
        ]


def one_run(folder: Path, environment: dict[str, str], duration: float, rate: float) -> Outcome:
    """Start a board, run an experiment with it, and return what came of it."""
    master, slave = os.openpty()
    tty.setraw(slave, termios.TCSANOW)
    port = os.ttyname(slave)
    board = subprocess.Popen(
        [sys.executable, __file__, "--serve", str(master)],
        pass_fds=[master],
        stdout=subprocess.PIPE,
        text=True,
    )
    os.close(master)
    (folder / "board.toml").write_text(EXPERIMENT.format(duration=duration, rate=rate, port=port))
    command = ["run", "board.toml", "--out", tempfile.mkdtemp(dir=folder), "--json"]
    try:
        ran = subprocess.run(
            [sys.executable, "-m", "servobench", *command],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
        )
    finally:
        os.close(slave)
        board.terminate()
        printed = board.communicate()[0]
    result = json.loads(ran.stdout) if ran.stdout.strip() else None
    return Outcome(
        status=ran.returncode,
        result=result,
        said=ran.stderr,
        late=json.loads(printed or "[]") or [math.nan] * 3,
    )


def runs(count: int, duration: float, rate: float) -> Iterator[Outcome]:
    """Give the outcomes of some runs, one after the other, each as it comes."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = installed(folder)
        for _ in range(count):
            yield one_run(folder, environment, duration, rate)


def main(count: int = COUNT, duration: float = DURATION, rate: float = RATE) -> list[Figure]:
    """Print what came of each run; return how many results are trusted, and how many intervals hold the truth."""
    outcomes = []
    for outcome in runs(count, duration, rate):
        _print(outcome)
        sys.stdout.flush()
        outcomes.append(outcome)
    held = {name: float(sum(name not in each.missed for each in outcomes)) for name in TRUTH}
    return [
        Figure(
            what=f"runs with a board that keeps the time that are trusted, of {count}",
            value=float(sum(each.trusted for each in outcomes)),
            at_least=float(count),
        ),
        *(
            Figure(
                what=f"intervals that hold the {name.replace('_', ' ')}, of {count}",
                value=value,
                at_least=float(_fewest(count)),
            )
            for name, value in held.items()
        ),
    ]


def _fewest(count: int) -> int:
    """As few 95 % intervals of so many as hold the truth in one series of a hundred, or more: of 20 it is 17."""
    chances = [math.comb(count, k) * 0.95**k * 0.05 ** (count - k) for k in range(count + 1)]
    return next(k for k in range(count + 1) if sum(chances[: k + 1]) >= 0.01)


def smallest() -> list[Figure]:
    """Return the same of one run of a second."""
    return main(1, 1.0)


def _print(outcome: Outcome) -> None:
    late = ", ".join(f"{1000 * each:.2f}" for each in outcome.late)
    print(f"status {outcome.status}, voltages after {late} ms (median, 99 of 100, most)", end="; ")
    if outcome.result is None:
        print(outcome.said.strip().splitlines()[-1:])
        return
    values = {name: each["interval"] for name, each in outcome.result["parameters"].items()}
    print(outcome.result["verdict"], values, *(f"misses {name}" for name in outcome.missed))
    if not outcome.trusted:
        for finding in outcome.result["findings"]:
            if finding["severity"] != "info":
                print("    ", finding["severity"], finding["sentence"])


def command() -> int:
    """Run as often and as long as the command line asks for, or be the board; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=COUNT, help="how many runs")
    parser.add_argument("--duration", type=float, default=DURATION, help="of a run [s]")
    parser.add_argument("--rate", type=float, default=RATE, help="ticks in a second")
    parser.add_argument("--serve", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve is not None:
        serve(given.serve)
        return 0
    return shown(main(given.count, given.duration, given.rate))


if __name__ == "__main__":
    sys.exit(command())

"""`servobench panel` as a program, the motor that it simulates, and a page of it in a browser."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any

PATIENCE = 240.0  # s; in a fresh clone all kernels are compiled before the device is open


@dataclass
class Terminal:
    """The output of a panel, read as it comes: all of it, and the links in it that weren't used yet."""

    process: subprocess.Popen[str]
    said: str = ""
    links: Queue[str] = field(default_factory=Queue)

    def __post_init__(self) -> None:
        self._reader = Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.said += line
            if found := re.search(r"(?:panel|for another browser): (https?://\S+)", line):
                self.links.put(found[1])

    def link(self) -> str:
        """The link that was printed after the last one that was taken."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until and (self.process.poll() is None or not self.links.empty()):
            try:
                return self.links.get(timeout=0.5)
            except Empty:
                continue
        raise AssertionError(f"no link was printed: {self.said}")

    def end(self, signal_: int) -> str:
        """Ask the program to end so, and return all that it has printed."""
        self.process.send_signal(signal_)
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        finally:
            self._reader.join(PATIENCE)
        assert self.process.stderr is not None
        self.process.stderr.close()
        return self.said


@dataclass
class Program:
    """A panel that is running: where it is, the folder of its recordings, its process, and what it prints."""

    base: str
    folder: Path
    process: subprocess.Popen[str]
    terminal: Terminal
    _first: str

    @property
    def address(self) -> str:
        """A link that nobody has used yet; each opens the panel once."""
        link, self._first = self._first or self.terminal.link(), ""
        return link

    @property
    def key(self) -> str:
        """The token of such a link."""
        return self.address.partition("/?token=")[2]

    @property
    def port(self) -> int:
        return int(self.base.rpartition(":")[2])


def started(folder: Path, *options: str, environment: Mapping[str, str] | None = None) -> Program:
    """Start `servobench panel` with a folder of recordings in a folder, and return it once its pages can be loaded.

    It opens no browser by itself, unless it is given an environment in which there is one.
    """
    recordings = folder / "recordings"
    command = [
        sys.executable,
        "-m",
        "servobench",
        "panel",
        "--no-open" if environment is None else "--open",
        "--port",
        "0",
        "--folder",
        str(recordings),
    ]
    process = subprocess.Popen(
        [*command, *options],
        stderr=subprocess.PIPE,
        text=True,
        bufsize=1,
        cwd=folder,
        start_new_session=True,
        env=None if environment is None else dict(environment),
    )
    terminal = Terminal(process)
    try:
        link = terminal.link()
    except BaseException:
        terminal.end(signal.SIGKILL)
        raise
    return Program(link.partition("/?token=")[0], recordings, process, terminal, link)


@contextmanager
def running(folder: Path, *options: str, environment: Mapping[str, str] | None = None) -> Iterator[Program]:
    """Run `servobench panel` as a person would, and end it with Ctrl-C; it has to end well, with the motor at rest."""
    program = started(folder, *options, environment=environment)
    try:
        yield program
    finally:
        said = program.terminal.end(signal.SIGINT)
    assert program.process.returncode == 0, said
    assert "the motor is at rest" in said


class Page:
    """The panel in a browser, as a person uses it: by roles and names. What the browser complains about is kept."""

    def __init__(self, browser: Any, address: str, *, script: str = "", **options: Any) -> None:
        self.context = browser.new_context(
            **{"viewport": {"width": 1440, "height": 900}, "color_scheme": "light", **options}
        )
        self.page = self.context.new_page()
        self.page.set_default_timeout(1000 * PATIENCE)
        self.driving = False
        self.held_up: list[str] = []
        """The reasons of faults of a busy computer, which a person acknowledges with one click."""
        self.complaints: list[str] = []
        self.page.on("console", lambda said: said.type == "error" and self.complaints.append(said.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.add_init_script(script)  # before any of the page's own
        self.page.goto(address)
        self.page.wait_for_selector("body.ready")

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: object) -> None:
        self.context.close()

    def button(self, name: str | re.Pattern[str]) -> Any:
        return self.page.get_by_role("button", name=name, exact=isinstance(name, str))

    def tab(self, name: str) -> None:
        self.page.get_by_role("tab", name=name, exact=True).click()

    def text(self, selector: str) -> str:
        return str(self.page.locator(selector).inner_text())

    def until(self, holds: Callable[[], bool]) -> None:
        """Wait until something holds; how long doesn't matter, but not for ever."""
        deadline = time.monotonic() + PATIENCE
        while not holds():
            assert time.monotonic() < deadline, "it never came to hold"
            self.see_to_a_busy_computer()
            self.page.wait_for_timeout(50)

    def see_to_a_busy_computer(self) -> None:
        """Acknowledge a fault that says that the computer was too busy for the loop, and go on where the motor was driven."""
        if self.page.locator("#go-on").is_visible():
            self.held_up.append(self.text("#fault-text"))
            self.button("Acknowledge and start" if self.driving else "Acknowledge").click()
            self.page.locator("#fault").wait_for(state="hidden")
        elif self.driving and "The driving page" in (why := self.text("#start-status")):
            self.held_up.append(why)  # so busy that the page couldn't draw: a person presses Start again
            self.button("Start").click()

    def apply(self, button: str, chip: str) -> None:
        """Press a button until the chip says that the loop has what was set: on a busy computer it may give no answer in time."""
        self.button(button).click()

        def applied() -> bool:
            if (said := self.text(chip)).startswith("No answer"):
                self.held_up.append(said)
                self.button(button).click()
            return said.startswith("Applied")

        self.until(applied)

    def start(self) -> None:
        """Start the motor, and wait until it is driven."""
        self.driving = True
        self.button("Start").click()
        self.until(lambda: self.text("#run-text") == "Driving")

    def scope(self, name: str) -> Any:
        return self.page.get_by_role("region", name=name, exact=True)

    def reading(self, scope: str, trace: str) -> float:
        """The number beside a trace's name; NaN where there is none yet."""
        entry = self.scope(scope).locator(".entry").filter(has_text=trace)
        text = entry.locator("output").inner_text().replace("−", "-")
        return float("nan") if text == "–" else float(text)

    def readings(self, scope: str, trace: str, seconds: float) -> list[float]:
        """The numbers that are shown beside a trace's name over some time in which nothing held the motor up."""
        found: list[float] = []
        held_up = -1
        while held_up != len(self.held_up):
            held_up = len(self.held_up)
            found.clear()
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                found.append(self.reading(scope, trace))
                self.page.wait_for_timeout(40)
            self.until(lambda: not self.driving or self.text("#run-text") == "Driving")
        return found

    def drive(self) -> None:
        """Wait until the device is open, and this page drives it."""
        self.until(lambda: self.text("#run-text") == "Zero volts")
        self.page.get_by_text("You drive").wait_for()


@dataclass(frozen=True)
class Truth:
    """The simulated motor's true parameters: gain [rad/(s·V)], time constant [s] and Coulomb voltage [V]."""

    gain: float
    time_constant: float
    coulomb_voltage: float


def truth_of_the_twin() -> Truth:
    """The parameters that follow from the equations of a DC motor and the default twin's physical parameters.

    J dω/dt = k i - b ω - τ_c sgn ω and L di/dt = u - R i - k ω have the gain k/(R b + k²), the poles of
    L J s² + (R J + L b) s + R b + k², of which the slower one is the time constant, and lose R τ_c/k to Coulomb friction.
    """
    import numpy as np

    from servobench.rig.devices.twin import TwinSettings
    from servobench.rig.motor.parameters import data_sheet

    settings = TwinSettings()
    motor = data_sheet(settings.motor).motor
    k, resistance = motor.motor_constant, motor.resistance
    inductance, viscous = motor.inductance, settings.viscous_friction
    damping = resistance * viscous + k**2
    poles = np.roots([inductance * motor.inertia, resistance * motor.inertia + inductance * viscous, damping])
    return Truth(k / damping, float(max(-1 / poles.real)), resistance * settings.coulomb_torque / k)

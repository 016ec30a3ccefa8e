"""A page that doesn't see the motor any more, each way that it can come to that, in a real Chromium with the real loop.

What the motor was given is in a journal: a plug-in device writes each voltage to a file, with the computer's monotonic time. How
far behind a page was is told by what it says itself, held against a second viewer, which takes rows as soon as they come.
"""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx

from tests.panel.doubles import rows_until
from tests.stories.program import Page, Program, running

TIMES = 20.0  # by which the page is slowed
LONG = 5.0  # s for which what was done to a page lasts
BEHIND = 2.0  # s by which a page comes to be behind
LIMIT = 1.0  # s within which zero volts have to be put out

DEVICE = '''
import os
import time

from servobench.rig.devices.twin import Twin


class Journal(Twin):
    """The simulated motor; each voltage that reaches it stands in a file, with the monotonic time."""

    def write(self, voltage):
        os.write(self._file(), b"%.6f %.6f\\n" % (time.monotonic(), voltage))
        return super().write(voltage)

    def stop(self):
        os.write(self._file(), b"%.6f 0\\n" % time.monotonic())
        super().stop()

    def _file(self):
        if not hasattr(self, "_journal"):
            self._journal = os.open(os.environ["SERVOBENCH_JOURNAL"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        return self._journal
'''
EXPERIMENT = """
[experiment]
sample_time = "{sample_time} s"

[signal]
type = "constant"
value = "2 V"

[device]
name = "journal"

[device.settings]
timing = "host"

[limits.watchdog]
timeout = "0.5 s"
"""

# What the page sends of how far it has drawn, with the time; and rows that come to it later by `window.late` [ms].
SCRIPT = """
(() => {
    window.beats = [];
    window.late = 0;
    const send = WebSocket.prototype.send;
    WebSocket.prototype.send = function (text) {
        const said = typeof text === "string" ? JSON.parse(text) : {};
        if (said.do === "beat") beats.push([performance.timeOrigin + performance.now(), said.row]);
        return send.call(this, text);
    };
    const listen = WebSocket.prototype.addEventListener;
    WebSocket.prototype.addEventListener = function (kind, run, ...rest) {
        if (kind !== "message") return listen.call(this, kind, run, ...rest);
        return listen.call(this, kind, (event) => {
            if (typeof event.data === "string" || !late) return run(event);
            setTimeout(() => run(event), late);
        }, ...rest);
    };
})();
"""


@dataclass
class Journal:
    """The voltages that reached the motor, each with its monotonic time [s]."""

    path: Path

    def lines(self) -> list[tuple[float, float]]:
        text = self.path.read_text(encoding="ascii") if self.path.exists() else ""
        whole = text[: text.rfind("\n") + 1]
        return [(float(line.split()[0]), float(line.split()[1])) for line in whole.splitlines()]

    def driven_until(self) -> float:
        """When the last voltage that wasn't zero was followed by zero; infinite while the motor is driven."""
        lines = self.lines()
        last = max(k for k, (_, voltage) in enumerate(lines) if voltage)
        return lines[last + 1][0] if last + 1 < len(lines) else float("inf")


@contextmanager
def panel(folder: Path, sample_time: float) -> Iterator[tuple[Program, Journal]]:
    """`servobench panel` with the device that keeps a journal, as a plug-in that is installed in a folder."""
    package = folder / "journal-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: journal\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text("[servobench.devices]\njournal = journal_device:Journal\n")
    (folder / "journal_device.py").write_text(DEVICE)
    (folder / "experiment.toml").write_text(EXPERIMENT.format(sample_time=sample_time))
    journal = Journal(folder / "voltages.txt")
    paths = [str(folder), *filter(None, [os.environ.get("PYTHONPATH")])]
    given = {"PYTHONPATH": os.pathsep.join(paths), "SERVOBENCH_JOURNAL": str(journal.path)}
    before = {name: os.environ.get(name) for name in given}
    os.environ.update(given)
    try:
        with running(folder, "--experiment", str(folder / "experiment.toml")) as program:
            yield program, journal
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


class Onlooker:
    """A viewer that takes what it is sent at once, in a thread: when rows came [s, monotonic], and the newest state."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self.state: dict[str, Any] = {}
        self.came: list[tuple[int, float]] = []  # the row after the newest one, and when it came
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        with suppress(Exception):  # it is closed
            for message in self._socket:
                if isinstance(message, bytes):
                    self.came.append((rows_until(message), time.monotonic()))
                elif (said := json.loads(message))["kind"] == "state":
                    self.state = said

    def came_at(self, row: int) -> float:
        """When the row of that number came."""
        known = list(self.came)
        k = bisect_right(known, row, key=lambda each: each[0])
        return known[k][1] if k < len(known) else float("inf")


@contextmanager
def onlooking(program: Program) -> Iterator[Onlooker]:
    """A second viewer of a panel."""
    from websockets.sync.client import connect

    with httpx.Client(base_url=program.base, timeout=30.0) as client:
        client.get(f"/?token={program.key}")
        token = client.get("/api/session", headers={"sec-fetch-site": "same-origin"}).json()["token"]
        cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
    with connect(
        program.base.replace("http", "ws") + "/ws",
        origin=program.base,  # type: ignore[arg-type]
        additional_headers={"cookie": cookie},
        max_size=None,
        proxy=None,
    ) as socket:
        socket.send(json.dumps({"do": "hello", "token": token}))
        yield Onlooker(socket)


@dataclass(frozen=True)
class Outcome:
    """The outcome for a motor whose page no longer shows it.

    `zero` is the time from what was done to the page until zero volts stood in the journal [s], infinite where they didn't;
    `behind` how old what the page showed was at most while the motor was driven [s]; `why` what the panel says.
    """

    zero: float
    behind: float
    why: str


def frozen(page: Page) -> Callable[[], None]:
    """Freeze it through the developer tools' protocol: no code of it goes on, and its browser answers for it."""
    tools = page.context.new_cdp_session(page.page)
    tools.send("Debugger.enable")
    tools.send("Debugger.pause")
    return lambda: tools.send("Debugger.disable")


def hung(page: Page) -> Callable[[], None]:
    """Let its main thread go round in circles."""
    page.page.evaluate(
        f"setTimeout(() => {{ const end = performance.now() + {1000 * LONG}; while (performance.now() < end); }}, 0)"
    )
    return lambda: None


def stopped(page: Page) -> Callable[[], None]:
    """Stop the process that runs it."""
    tools = page.context.browser.new_browser_cdp_session()
    known = tools.send("SystemInfo.getProcessInfo")["processInfo"]
    renderers = [each["id"] for each in known if each["type"] == "renderer"]
    for each in renderers:
        os.kill(each, signal.SIGSTOP)

    def undo() -> None:
        for each in renderers:
            os.kill(each, signal.SIGCONT)

    return undo


def slowed(page: Page) -> Callable[[], None]:
    """Slow its processor."""
    tools = page.context.new_cdp_session(page.page)
    tools.send("Emulation.setCPUThrottlingRate", {"rate": TIMES})
    return lambda: tools.send("Emulation.setCPUThrottlingRate", {"rate": 1})


def late(page: Page) -> Callable[[], None]:
    """Let its rows come late, as by a slow line; its code and its drawing go on as before."""
    page.page.evaluate(f"window.late = {1000 * BEHIND}")
    return lambda: page.page.evaluate("window.late = 0")


WAYS: dict[str, Callable[[Page], Callable[[], None]]] = {
    "frozen": frozen,
    "main thread in an endless loop": hung,
    "renderer stopped": stopped,
    "slowed 20 times": slowed,
    "2 s behind": late,
}


def unseen(browser: Any, program: Program, journal: Journal, way: str) -> Outcome:
    """Drive the motor from a page, do that to the page, and return what became of the motor.

    A fault, such as a loop that a busy computer has held up, stops the motor as well and tells nothing of the page. Nor does a
    time that is over the limit by less than the loop's process stood still meanwhile. Then it is done again.
    """
    for _ in range(5):
        with ExitStack() as stack:
            onlooker = stack.enter_context(onlooking(program))
            page = stack.enter_context(Page(browser, program.address, script=SCRIPT))
            page.drive()
            page.start()
            page.page.wait_for_timeout(1000)  # the page shows a motor that turns
            undo = None
            done = time.monotonic()
            try:
                undo = WAYS[way](page)
                ended = watched(onlooker, journal, done)
            finally:
                if undo is not None:
                    undo()
            over = journal.driven_until() - done - LIMIT
            if ended is not None and not 0 < over <= stalled(journal, done):
                page.page.wait_for_function("() => true")  # it goes on
                beats = page.page.evaluate("() => beats")
                return Outcome(
                    zero=journal.driven_until() - done,
                    behind=furthest(beats, onlooker, done, min(ended, journal.driven_until())),
                    why=onlooker.state["stopped"],
                )
    raise AssertionError("a busy computer stopped the motor each time, before the page could")


def watched(onlooker: Onlooker, journal: Journal, done: float) -> float | None:
    """Wait until the motor is at zero volts, or for `LONG`; return when that was, None where a fault stopped it."""
    while (now := time.monotonic()) < done + LONG:
        if onlooker.state.get("fault") or journal.driven_until() < done:
            return None
        if journal.driven_until() < now and onlooker.state.get("stopped"):
            return now
        time.sleep(0.02)
    return done + LONG


def stalled(journal: Journal, begin: float) -> float:
    """The longest time for which no voltage was written, from a monotonic time until zero volts [s]: nothing ran meanwhile."""
    times = [begin, *(when for when, _ in journal.lines() if begin < when <= journal.driven_until())]
    return max((b - a for a, b in pairwise(times)), default=0.0)


def furthest(beats: list[tuple[float, int]], onlooker: Onlooker, begin: float, end: float) -> float:
    """The age of the oldest row that the page hadn't drawn, by its own beats, at most between two monotonic times [s].

    Infinite where it never said what it had drawn.
    """
    if not beats:
        return float("inf")
    shift = time.time() - time.monotonic()
    said = [(when / 1000 - shift, row) for when, row in beats]
    oldest = 0.0
    for (when, row), until in zip(said, [*(each for each, _ in said[1:]), float("inf")], strict=True):
        seen_last = min(until, end)
        if seen_last > max(when, begin):
            oldest = max(oldest, seen_last - onlooker.came_at(row))
    return oldest
